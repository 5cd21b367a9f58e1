"""The noise that a flow leaves where magnitudes have no signal, measured on cubes of the volume."""

from dataclasses import replace

import numpy as np

from meshflow.estimate.magnitudes import Magnitudes
from meshflow.estimate.plan import Plan
from meshflow.estimate.second_stage import after_the_flow, cut_out
from meshflow.estimate.volume_pieces import MARGIN, cubes
from meshflow.estimate.volume_search import WHOLE
from meshflow.geometry.validation import Array
from meshflow.surfaces.volume import Block

__all__ = ["without_noise_as_signal"]

# The number of cubes; the least number of samples by which the noise is told; how many deviations of it are no signal.
CUBES, ENOUGH, WITHIN = 8, 200, 2.0
# Between the median and the first decile of what is below the mean lie 0.97 deviations if it is cut there, 1.28 if all is below.
APART = 1.1


def without_noise_as_signal(plan: Plan) -> Plan:
    """The plan of a search on magnitudes, whose way back takes the noise that is left in the air for no signal.

    What is below the mean of no signal is noise alone, which the flow leaves. Methods that the caller names have the way back
    without bias, in windows and elsewhere.
    """
    how = plan.preparation
    by = None if how is None else how.stabilizer
    if how is None or by is None or not plan.candidates or plan.idle is not None or not isinstance(plan.grid, Block):
        return plan
    if not any(isinstance(one, Magnitudes) for one in by.noise):
        return plan
    found, threads = [], plan.request.compute.threads
    small = plan.grid.missing.size <= WHOLE
    whole = tuple(slice(0, side) for side in plan.grid.shape)
    for window in [whole] if small else cubes(plan.grid, CUBES):
        part = cut_out(plan.grid, window)
        planes, _ = after_the_flow(plan, part, None, threads)
        cut = [side > 3 * MARGIN and not small for side in part.shape]
        inner = tuple(slice(MARGIN, -MARGIN) if each else slice(None) for each in cut)
        free = ~(part.missing | part.fixed)[inner]
        found.append([plane[inner][free] for plane in planes])
    left = tuple(
        _within(np.concatenate([one[k] for one in found]), table[2, 1]) if found and table is not None else 0.0
        for k, table in enumerate(by.tables)
    )
    return replace(plan, preparation=replace(how, stabilizer=by.after(left)))


def _within(values: Array, mean: float) -> float:
    """How far above the mean of no signal values (m,) may be without one; 0 where few are below it.

    By quantiles of those below, so that it does not matter much whether the mean is a little off.
    """
    below = values[values < mean]
    if below.size < ENOUGH:
        return 0.0
    median, decile = np.quantile(below.astype(np.float64), (0.5, 0.1))
    return WITHIN * float(median - decile) / APART
