"""What results say of their parameters and candidates: as text, and as numbers."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Protocol

from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Parameter
from meshflow.estimate.risk import Candidate, as_good

__all__ = ["as_numbers", "as_text", "candidates_in_numbers", "chosen_in", "described"]

# The parameters that a summary names, in this order.
SUMMED = (
    "method", "order", "weights", "presmooth", "gamma", "sharpness", "patch", "contrast", "crease_contrast", "crease_sharpness",
    "regularize", "feature_length", "normal_weight",
)  # fmt: skip


def chosen_in(parameters: Mapping[str, Parameter], hidden: Collection[str] = ()) -> str:
    """The parameters that a summary names, with a semicolon after them; empty where there are none.

    :param hidden: names that are left out.
    """
    names = [name for name in SUMMED if name in parameters and name not in hidden]
    chosen = ", ".join(f"{name.replace('_', ' ')} {_short(parameters[name].value)}" for name in names)
    return f"{chosen}; " if chosen else ""


def as_text(parameters: Mapping[str, Parameter]) -> dict[str, str]:
    """The values of parameters as text, for the tags of files."""
    values = {name: parameter.value for name, parameter in parameters.items()}
    return {name: value if isinstance(value, str) else f"{value:.6g}" for name, value in values.items()}


def as_numbers(parameters: Mapping[str, Parameter]) -> dict[str, dict[str, Any]]:
    """Parameters in types of JSON."""
    return {
        name: {"value": p.value, "unit": p.unit, "origin": p.origin, **({"why": p.why} if p.why else {})}
        for name, p in parameters.items()
    }


def candidates_in_numbers(candidates: Sequence[Candidate]) -> list[dict[str, Any]]:
    """The candidates of a search in types of JSON, the first one with its curve; all curves are hundreds of numbers."""
    return [
        {
            **candidate.configuration.words,
            "time": candidate.least[0],
            "risk": candidate.risk,
            **({"curve": {"times": list(candidate.times), "risks": list(candidate.risks)}} if i == 0 else {}),
        }
        for i, candidate in enumerate(candidates)
    ]


class Described(Protocol):
    """A run whose reasons are known."""

    @property
    def stopped_because(self) -> str:
        """A sentence."""
        ...

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """By name."""
        ...

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Those of the search."""
        ...

    @property
    def noise(self) -> Noise:
        """That was found or given."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences."""
        ...


def described(run: Described, removed: str) -> str:
    """A run as lines of text: why it ended, its parameters, what was removed, candidates, noise and warnings.

    :param removed: in words; empty where it is not known.
    """
    lines = [run.stopped_because]
    lines += [f"  {name:<12} {parameter}" for name, parameter in run.parameters.items()]
    lines += [f"  removed      {removed}"] if removed else []
    lines += _searched(run.candidates)
    lines += [f"  noise        {sentence}" for sentence in run.noise.sentences() if sentence not in run.warnings]
    return "\n".join(lines + [f"  warning      {warning}" for warning in run.warnings])


def _searched(candidates: Sequence[Candidate]) -> list[str]:
    """Lines on the best candidates of a search; none where nothing was searched for."""
    if not candidates:
        return []
    lines = [f"  searched     {len(candidates)} candidates; expected errors (rms), least first:"]
    for candidate in sorted(candidates, key=lambda candidate: candidate.least[1])[:5]:
        words = (
            f"{k} {v if isinstance(v, str) else format(v, '.4g')}" for k, v in candidate.configuration.words.items()
        )
        error = f"{candidate.risk:.6g}" if candidate.least[1] > 0 else "below what can be measured"
        near = "; equally good within the uncertainty" if as_good(candidate, candidates[0]) else ""
        lines.append(f"               {error} at time {candidate.least[0]:.4g}: {', '.join(words)}{near}")
    return lines


def _short(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"
