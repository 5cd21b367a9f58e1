"""Converts a request to arguments of the command line."""

from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Search
from meshflow.geometry.options import options_of

__all__ = ["flags_of"]


def flags_of(request: Request) -> list[str]:
    """The arguments of the command line for a request, without its arrays and callables."""
    words: list[str] = []
    method = request.method
    for kind, part in ((Request, request), (Compute, request.compute), (type(method), method)):
        if part is None:
            continue
        if part is method and method is not None and type(method) is not Search:
            words += ["--method", method.word]
        for option in options_of(kind):
            value = getattr(part, option.name)
            if option.has_flag and value != option.default and isinstance(value, (str, int, float)):
                if isinstance(value, bool):
                    words.append(_flag(option.name if value else f"no_{option.name}"))
                else:
                    words += [_flag(option.name), str(value)]
    preserve = request.constraints.preserve
    return [*words, "--preserve", "scaling" if preserve == "scale" else preserve] if preserve else words


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"
