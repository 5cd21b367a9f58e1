"""How a flow is computed: stepper, triangulation, threads."""

from contextlib import AbstractContextManager
from dataclasses import dataclass

from meshflow.errors import InputError
from meshflow.flow.controls import AreaChange, Embedded, FixedStep
from meshflow.flow.steppers import Stepper, StepperName, stepper_word
from meshflow.geometry.delaunay import Triangles
from meshflow.geometry.options import must_be_object, named_fields, option
from meshflow.geometry.validation import positive, shown, whole
from meshflow.kernels.library import default_threads, using_threads
from meshflow.surfaces.triangles import Diagonals

__all__ = ["Compute"]


@named_fields
@dataclass(frozen=True, kw_only=True)
class Compute:
    """How a flow is computed.

    :raises InputError: for unknown words, and options that exclude each other.
    """

    stepper: Stepper | StepperName = option("auto", "The time stepper.")
    dt: float | None = option(None, "Length of a time step. Default: chosen for the stepper.", "squared length")
    control: FixedStep | AreaChange | Embedded | None = option(
        None, "Control of the step lengths, in place of dt.", flag="-"
    )
    threads: int | None = option(None, "Number of threads. Default: one per core.")
    diagonals: Diagonals = option("alternate", "Diagonals that divide the cells of a grid into triangles.")
    triangles: Triangles = option(
        "auto",
        "Which triangles of a mesh give the cotangents: its own (given), or those of its intrinsic Delaunay "
        "triangulation. clamped sets negative weights to zero, so that no value leaves its range.",
    )
    search: bool | None = option(
        None,
        "Search for the options that you do not give. Without a search they follow a rule. Default: yes, except for "
        "depth.",
    )

    def __post_init__(self) -> None:
        if self.dt is not None and self.control is not None:
            raise InputError(f"dt {self.dt} and control {self.control}: one of them expected; give dt to the control")
        if self.dt is not None:
            positive(self.dt, "dt")
        if self.threads is not None:
            whole(self.threads, "threads", 1)
        must_be_object(self.control, "control: FixedStep, AreaChange or Embedded")
        if self.control is not None and not isinstance(self.control, (FixedStep, AreaChange, Embedded)):
            raise InputError(f"control: FixedStep, AreaChange or Embedded expected, got {shown(self.control)}")
        stepper_word(self.stepper)
        if self.triangles == "clamped" and self.stepper == "super-time":
            raise InputError(
                "triangles='clamped': stepper explicit or semi-implicit expected, got 'super-time', which may overshoot"
            )

    def running(self) -> AbstractContextManager[None]:
        """While it lasts, loops that are called from here use the threads that are asked for."""
        return using_threads(self.threads)

    @property
    def workers(self) -> int:
        """How many threads: those that are given, or as many as the process may use."""
        return default_threads() if self.threads is None else self.threads

    @property
    def stepping(self) -> bool:
        """Whether the caller determines the steps."""
        return self.stepper != "auto" or self.dt is not None or self.control is not None
