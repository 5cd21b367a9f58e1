"""The parameters of a plan for reports, each with value, unit, origin and reason."""

import numpy as np

from meshflow.estimate.magnitudes import Magnitudes
from meshflow.estimate.parameters import Parameter, contrast_unit, squared_unit, value_unit
from meshflow.estimate.plan import Decided, Part, Plan
from meshflow.estimate.risk import Candidate
from meshflow.flow.controls import AreaChange, Embedded, FixedStep
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.flow.methods.between_voxels import BetweenVoxels
from meshflow.flow.stops import AreaLoss, Displacement, Residual, When
from meshflow.geometry.options import options_of
from meshflow.geometry.validation import truth_of
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh

__all__ = ["risk_of", "parameters_of"]


def parameters_of(plan: Plan) -> dict[str, Parameter]:
    """The parameters of a plan, in reading order."""
    time = {"time": _decided(plan, "time", plan.time, squared_unit(plan.data))}
    return {
        **_of_noise(plan),
        **_of_method(plan),
        **time,
        **_of_search(plan),
        **_of_constraints(plan),
        **_of_request(plan),
    }


def _decided(plan: Plan, name: str, value: float | str, unit: str = "") -> Parameter:
    decided = plan.decided.get(name, Decided())
    return Parameter(value, unit, decided.origin, decided.why)


def _of_noise(plan: Plan) -> dict[str, Parameter]:
    how = {"given": "", "nothing": "too few samples"}.get(plan.noise.how, f"from {plan.noise.how}")
    if plan.noise.correlation is not None:
        how += f", correlated over about {plan.noise.length:.2g} samples"
    why = plan.decided["noise"].why if "noise" in plan.decided else how
    unit, strength = value_unit(plan.data), plan.request.strength
    found = {"noise": Parameter(plan.noise.sigma, unit, "given" if plan.noise.how == "given" else "estimated", why)}
    if plan.noise.by_intensity:
        origin = "estimated" if plan.request.domain == "auto" else "given"
        if any(isinstance(one, Magnitudes) for one in plan.noise.by_intensity):
            found["domain"] = Parameter(
                "magnitudes", "", origin, "the same noise at every signal, without the bias of Rice"
            )
        else:
            found["noise"] = Parameter(plan.noise.sigma, unit, "estimated", f"at the median intensity, {how}")
            found["domain"] = Parameter("stabilized", "", origin, "the same noise at every intensity")
    if plan.points is None:
        found["quantum"] = Parameter(plan.noise.quantum, unit, "estimated")
    return {**found, "strength": Parameter(strength, "", "default" if strength == 1.0 else "given")}


def _of_method(plan: Plan) -> dict[str, Parameter]:
    """The method and its options, and the settings of the surface."""
    method, found = plan.method, {"method": _decided(plan, "method", plan.method.word)}
    if isinstance(method, HeightMethod):
        variant = plan.variant
        for name, unit in (("gamma", ""), ("sharpness", ""), ("patch", "samples")):
            found[name] = _decided(plan, name, float(getattr(variant, name)), unit)
    units = {
        "contrast": contrast_unit(plan.data),
        "regularize": squared_unit(plan.data),
        "presmooth": squared_unit(plan.data),
    }
    for option in options_of(type(method)):
        value = getattr(method, option.name)
        if value is None or option.name == "second_stage" or (option.name == "along" and value == "all"):
            continue
        unit = units.get(option.name, option.unit)
        found.setdefault(
            option.name, _decided(plan, option.name, value if isinstance(value, str) else float(value), unit)
        )
    if plan.points is not None and isinstance(plan.data, Mesh) and plan.data.moves == "all":
        found["contrast"] = _decided(plan, "contrast", plan.lift.contrast, units["contrast"])
    if isinstance(method, HeightMethod) and (plan.groups is not None or plan.request.heights.second_stage is not None):
        found["second_stage"] = _decided(plan, "second_stage", "no" if plan.groups is None else "yes")
    curve = plan.setting is not None and plan.setting.curve
    found["boundary"] = _decided(
        plan, "boundary", "border-curve" if curve else plan.lift.boundary or plan.data.boundary
    )
    if plan.base is not None:
        found["base"] = Parameter("the data at a larger scale", "", "default", "a slope is not an edge")
    if not isinstance(plan.data, (Mesh, TetMesh)):
        found["diagonals"] = Parameter(plan.lift.diagonals)
    if plan.setting is not None:
        thin = plan.decided.get("triangles", Decided()).origin == "estimated"
        own = "delaunay" if thin else "given" if plan.setting.triangles == "auto" else plan.setting.triangles
        found["triangles"] = _decided(plan, "triangles", own)
    elif isinstance(plan.data, Mesh):
        found["triangles"] = _decided(plan, "triangles", plan.request.compute.triangles)
    if isinstance(plan.data, RangeImage):
        found["time_unit"] = _decided(plan, "time_unit", plan.data.time_unit)
    return found


def _of_search(plan: Plan) -> dict[str, Parameter]:
    """The expected error of the chosen candidate."""
    if not plan.candidates:
        return {}
    along = "along the normals" if plan.points is not None else ""
    found: dict[str, Parameter] = {}
    if plan.blend:
        words = [f"{part.weight:.2f} of {_brief(part)}" for part in plan.blend]
        found["blend"] = Parameter(", ".join(words), "", "estimated", "weights of least estimated risk")
    return {**found, "risk": risk_of(plan.candidates[0], value_unit(plan.data), along)}


def _brief(part: Part) -> str:
    """A run of a blend in a few words."""
    of = part.method.variant
    return f"gamma {of.gamma:g}, sharpness {of.sharpness:g}, patch {of.patch:g} at time {part.time:.4g}"


def risk_of(candidate: Candidate, unit: str, along: str = "") -> Parameter:
    """The expected error of a candidate; a negative mean square is reported as below what can be measured."""
    words = f"root mean square error {along or 'to be expected'}"
    if candidate.least[1] <= 0:
        words = f"below what can be measured; {words}"
    return Parameter(candidate.risk, unit, "estimated", words)


def _of_constraints(plan: Plan) -> dict[str, Parameter]:
    """The constraints."""
    asked, found = plan.request.constraints, {}
    if plan.max_change is not None:
        most = float(plan.max_change) if np.ndim(plan.max_change) == 0 else "one per sample"
        found["max_change"] = _decided(plan, "max_change", most, value_unit(plan.data))
    elif isinstance(plan.method, BetweenVoxels):
        found["max_change"] = _decided(plan, "max_change", 0.5, "voxels")
    if plan.pull is not None:
        found["data_weights"] = Parameter("weights", "", "given", "1 / squared value")
    if asked.mask is not None:
        found["mask"] = _counted(truth_of(np.asarray(asked.mask)), "may move")
    if asked.mobility is not None:
        mobility = float(asked.mobility) if np.ndim(asked.mobility) == 0 else "one per sample"
        found["mobility"] = Parameter(mobility, "", "given", "0 fixed, 1 free")
    if plan.stays is not None and plan.stays.any():
        found["fixed"] = _counted(plan.stays, "stay")
    if plan.preserve is not None:
        found["preserve"] = _decided(plan, "preserve", plan.preserve)
    if plan.recentred:
        found["offsets"] = _decided(plan, "offsets", "removed")
    if plan.of_round_parts is not None:
        found["round_parts"] = _decided(plan, "round_parts", "of a short run")
    if asked.min_component is not None:
        found["min_component"] = Parameter(float(asked.min_component), "samples", "given")
    return found


def _of_request(plan: Plan) -> dict[str, Parameter]:
    """Given options that are not reported elsewhere."""
    request, compute, found = plan.request, plan.request.compute, {}
    if request.steps is not None:
        found["steps"] = Parameter(float(request.steps), "", "given")
    for stop in request.stops:
        if isinstance(stop, Residual):
            found["residual"] = Parameter(stop.share, "of sigma", "given")
        elif isinstance(stop, AreaLoss):
            found["area_loss"] = Parameter(stop.share, "of the area", "given")
        elif isinstance(stop, Displacement):
            found["displacement"] = Parameter(stop.most, value_unit(plan.data), "given")
        elif isinstance(stop, When):
            found["stop"] = Parameter(getattr(stop.asked, "__name__", "a callable"), "", "given")
    if compute.dt is not None:
        found["dt"] = Parameter(compute.dt, squared_unit(plan.data), "given")
    if compute.threads is not None:
        found["threads"] = Parameter(float(compute.threads), "", "given")
    if compute.stepper != "auto":
        word = compute.stepper if isinstance(compute.stepper, str) else compute.stepper.name
        found["stepper"] = Parameter(word, "", "given")
    if isinstance(compute.control, (FixedStep, AreaChange, Embedded)):
        found["control"] = Parameter(str(compute.control), "", "given")
    if compute.search is not None:
        found["search"] = Parameter("yes" if compute.search else "no", "", "given")
    return found


def _counted(mask: np.ndarray, what: str) -> Parameter:
    return Parameter(f"{int(mask.sum())} of {mask.size} samples {what}", "", "given")
