"""The plan of a run for data of any kind."""

from dataclasses import replace

from meshflow.estimate.plan import Plan
from meshflow.estimate.planner import plan_of_surface
from meshflow.estimate.quantized import LeastBending
from meshflow.estimate.request import Request
from meshflow.estimate.volumes import plan_of_solid
from meshflow.flow.methods.searched import Quick
from meshflow.surfaces.data import Data
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = ["plan", "plan_of_flow"]


def plan(data: Data, request: Request) -> Plan:
    """The plan for data of any kind.

    :raises InputError: for options that do not apply to the kind of data, and constraints that do not fit it.
    """
    return plan_of_solid(data, request) if isinstance(data, (Volume, TetMesh)) else plan_of_surface(data, request)


def plan_of_flow(data: Data, request: Request) -> Plan:
    """:func:`plan` with states on the way: a flow also where the default is none.

    :raises InputError: likewise.
    """
    found = plan(data, request)
    return plan(data, replace(request, method=Quick())) if isinstance(found.method, LeastBending) else found
