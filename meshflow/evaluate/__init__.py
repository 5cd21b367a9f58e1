"""How good it is, beside others: metrics, quality against the truth, and the comparison of the flows."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshflow.evaluate.flows import FlowComparison, compare_flows

__all__ = ["FlowComparison", "compare_flows"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'meshflow.evaluate' has no attribute {name!r}; it has {', '.join(__all__)}")
    from meshflow.evaluate import flows

    return getattr(flows, name)
