"""What is said of bad usage: in our words, with the nearest option or word, and hints for names of other tools."""

import re
from collections.abc import Sequence
from typing import Any

from meshflow.geometry.options import expected, nearest

__all__ = ["usage"]

_AMOUNT = "the amount of smoothing is set by --time (or --scale, a length); --steps is a number of steps"
_TAUBIN = "the flow has --time; --method fairing --order N keeps the volume, as lambda and mu of Taubin do"
_FLAGS = {
    "iterations": _AMOUNT,
    "iter": _AMOUNT,
    "n-iter": _AMOUNT,
    "niter": _AMOUNT,
    "lambda": _TAUBIN,
    "lamb": _TAUBIN,
    "mu": "for lambda and mu of Taubin use --method fairing --order N",
    "pass-band": "for a low-pass filter of a mesh use --method fairing --order N",
    "sigma": "the noise is set by --noise; the width of a Gaussian by --scale",
    "sigma-color": "the noise is set by --noise; the width of a Gaussian by --scale",
    "sigma-space": "the width of a Gaussian is set by --scale",
    "kappa": "the slope that counts as an edge is set by --contrast (its inverse)",
    "radius": "the width of a Gaussian is set by --scale",
    "output": "the output is the second argument: smooth IN OUT",
    "only": "the samples that may move are named by --mask, those that stay by --fixed: a file, an attribute, or 'z > 2'",
    "box": "a region is an expression: --mask 'box(0,0,0,1,1,1)'",
    "sphere": "a region is an expression: --mask 'sphere(0,0,0,2)'",
    "force": "use --overwrite to replace a file",
    "driver": "a driver of GDAL is named by --of; else the extension names the format",
    "format": "a driver of GDAL is named by --of; else the extension names the format",
    "profile": "creation options are --co NAME=VALUE",
    "srcwin": "a part is read with --window COLUMN ROW WIDTH HEIGHT",
    "projwin": "a part is read with --bounds LEFT BOTTOM RIGHT TOP",
    "bands": "use --band to choose a band",
}
_ONE_OF = re.compile(r"(?:Value error, )?'([^']*)' is not one of ((?:'[^']*'(?:, )?)+)")
_NUMBER = re.compile(r"Input should be a valid (number|integer), .*")


def usage(refusal: Any, arguments: Sequence[str]) -> str:
    """One sentence on bad usage.

    :param refusal: what typer raises, a ``UsageError``.
    :param arguments: those of the command line.
    """
    message = " ".join(refusal.format_message().split()).rstrip(".")
    unknown = re.match(r"No such option:? '?(--?[\w-]+)", message)
    if unknown:
        return _unknown(unknown[1], refusal.ctx)
    message = _ONE_OF.sub(lambda found: expected(found[1], re.findall(r"'([^']*)'", found[2])), message)
    flag = re.search(r"'(--?[\w-]+)'", message)
    given = _given(flag[1], arguments) if flag else ""
    got = f", got {given!r}" if given else ""
    return _NUMBER.sub(lambda found: f"a {'whole ' * (found[1] == 'integer')}number expected{got}", message)


def _unknown(flag: str, context: Any) -> str:
    """An option that does not exist, with the hint for those of other tools, or the nearest one."""
    hint = _FLAGS.get(flag.lstrip("-").lower().replace("_", "-"), "")
    if not hint and context is not None:
        there = [word for parameter in context.command.params for word in parameter.opts if word.startswith("--")]
        near = nearest(flag.replace("_", "-"), there)
        hint = f"did you mean {near}?" if near else ""
    return f"No such option: {flag}{'; ' if hint else ''}{hint}"


def _given(flag: str, arguments: Sequence[str]) -> str:
    """What was given for a flag; empty where it is not found."""
    for one, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if one == flag:
            return following
        if one.startswith(f"{flag}="):
            return one.partition("=")[2]
    return ""
