"""How good it is, beside others: metrics, samples with known answers, baselines, and the comparison of the flows."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshflow.study.flows import FlowComparison, compare_flows

__all__ = ["FlowComparison", "compare_flows"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'meshflow.study' has no attribute {name!r}; it has {', '.join(__all__)}")
    from meshflow.study import flows

    return getattr(flows, name)
