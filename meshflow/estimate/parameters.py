"""What was chosen, in which unit, and who chose it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshflow.estimate.noise import Noise
from meshflow.estimate.risk import Trial
from meshflow.estimate.settings import Settings
from meshflow.flow.conservation import Keep
from meshflow.flow.constraints import Limit
from meshflow.flow.controls import Until
from meshflow.flow.methods.beltrami import Member
from meshflow.flow.methods.motion import Motion
from meshflow.geometry.validation import Array, truth_of
from meshflow.surfaces.lift import HeightField, Image, Lift, Mesh, Noun, RangeImage

__all__ = [
    "Origin",
    "Parameter",
    "Plan",
    "contrast_unit",
    "expected_error",
    "given_words",
    "squared_unit",
    "value_unit",
]

Origin = Literal["given", "estimated", "default"]


@dataclass(frozen=True)
class Parameter:
    """A parameter as it was used.

    :ivar value: a number or a word.
    :ivar unit: of a number; empty where it has none, or where nobody has said which.
    :ivar origin: ``given | estimated | default``.
    :ivar why: a few words, where there is a reason to tell.
    """

    value: float | str
    unit: str = ""
    origin: Origin = "default"
    why: str = ""

    def __str__(self) -> str:
        value = self.value if isinstance(self.value, str) else f"{self.value:.6g}"
        words = ", ".join(word for word in (self.origin, self.why) if word)
        return f"{value}{' ' + self.unit if self.unit else ''} ({words})"


@dataclass(frozen=True, eq=False)
class Plan:
    """What is run.

    :ivar noise: what was found, or given; None for bare points.
    :ivar idle: why nothing is done; None where something is.
    :ivar trials: of the search, the chosen one first.
    :ivar twice: w of u(t) + w (u(t) - u(2 t)), t the time of ``until``.
    :ivar limit: what no coordinate leaves, made of the start of a flow.
    :ivar trust: of the fidelity, (n, k), (n, 1) or (1, 1), per time; None: none.
    :ivar speed: (n, 1), of each sample; None: all go freely.
    :ivar motion: of a mesh whose points move; None of everything else.
    :ivar keep: what it keeps.
    """

    noun: Noun
    member: Member
    lift: Lift
    until: Until
    parameters: dict[str, Parameter]
    noise: Noise | None = None
    idle: str | None = None
    trials: tuple[Trial, ...] = ()
    twice: float = 0.0
    limit: Callable[[Array], Limit] | None = None
    trust: Array | None = None
    speed: Array | None = None
    motion: Motion | None = None
    keep: Keep | None = None
    warnings: tuple[str, ...] = ()

    @property
    def there(self) -> float:
        """The share of the samples that are there."""
        if isinstance(self.noun, Mesh):
            return 1.0
        return float(np.mean(~self.noun.missing))


def value_unit(noun: Noun) -> str:
    """The unit of what is smoothed, where the data names it."""
    return noun.unit if isinstance(noun, (HeightField, RangeImage)) else ""


def squared_unit(noun: Noun) -> str:
    """The unit of time."""
    if isinstance(noun, RangeImage):
        return "pixel footprints²" if noun.pace != "length" else f"{noun.unit}²" if noun.unit else "squared length"
    if isinstance(noun, HeightField) and noun.unit:
        return f"{noun.unit}²"
    if isinstance(noun, Image) and np.ndim(noun.spacing[0]) == 0 and noun.spacing == (1.0, 1.0):
        return "pixels²"
    return "squared length"


def contrast_unit(noun: Noun) -> str:
    """The unit of the contrast: none where value and length share theirs."""
    if isinstance(noun, Image):
        return "pixels per unit" if squared_unit(noun) == "pixels²" else "length per unit"
    return "length per unit" if isinstance(noun, Mesh) and noun.moves != "points" else ""


def given_words(noun: Noun, settings: Settings) -> dict[str, Parameter]:
    """What the caller has said that no other parameter tells; ``noun`` as it came."""
    found: dict[str, Parameter] = {}
    units = {
        "displacement": value_unit(noun),
        "dt": squared_unit(noun),
        "residual": "of sigma",
        "area_loss": "of the area",
    }
    for name in ("method", "residual", "area_loss", "displacement", "dt", "threads"):
        value = getattr(settings, name)
        if value is not None:
            found[name] = Parameter(value if isinstance(value, str) else float(value), units.get(name, ""), "given")
    for name in ("stepper", "control", "stop"):
        value = getattr(settings, name)
        if value not in (None, "auto"):
            word = value if isinstance(value, str) else getattr(value, "__name__", None) or str(value)
            found[name] = Parameter(word, "", "given")
    if settings.search is not None:
        found["search"] = Parameter("yes" if settings.search else "no", "", "given")
    if settings.islands is not None:
        found["islands"] = Parameter(float(settings.islands), "samples", "given")
    if settings.only is not None:
        found["only"] = _counted(truth_of(np.asarray(settings.only)), "may move")
    if settings.speed is not None:
        speed = float(settings.speed) if np.ndim(settings.speed) == 0 else "one per sample"
        found["speed"] = Parameter(speed, "", "given", "0 stays, 1 goes freely")
    if noun.fixed is not None and noun.fixed.any():
        found["fixed"] = _counted(noun.fixed, "stay")
    return found


def expected_error(trial: Trial, unit: str, along: str = "") -> Parameter:
    """What a trial is expected to leave; a mean square below zero is told as what it is, no error of zero."""
    words = f"root mean square error {along or 'to be expected'}"
    if trial.least[1] <= 0:
        words = f"estimated below zero: sigma was taken for a little more than it is; {words}"
    return Parameter(trial.risk, unit, "estimated", words)


def _counted(mask: np.ndarray, what: str) -> Parameter:
    return Parameter(f"{int(mask.sum())} of {mask.size} samples {what}", "", "given")
