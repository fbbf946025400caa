"""One camera from pictures to a document: the lens that they call for, the fit, what does not fit, the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinan.calibration.cameras.camera import FORMS, CameraFit, Comparison, Form, compare, fit_without_misfits, form
from sinan.calibration.cameras.views import View, Views
from sinan.experiments.camera.loop import CameraTrace, document, trace
from sinan.sensors.arrays import finite_or_none
from sinan.sensors.errors import InputError

#: What stands for the lens that the held-out pictures call for, and the lens where there are too few to hold any out.
AUTO, FEW = "auto", "k1 k2"


@dataclass(frozen=True)
class Study:
    """A calibrated camera, and how it came about.

    Attributes
    ----------
    views : as read
    found : the fit
    aside : pictures that do not fit, with their RMS by the camera [pixels]
    compared : the forms on held-out pictures; empty where one was asked for, or there are too few pictures
    looped : calibrated without distortion, traced; None where the pictures do not bear that
    """

    views: Views
    found: CameraFit
    aside: tuple[tuple[str, float], ...]
    compared: list[Comparison]
    looped: CameraTrace | None

    @property
    def kept(self) -> Sequence[View]:
        """The pictures that fit."""
        return self.found.views


def study(views: Views, lens: str = AUTO) -> Study:
    """Calibrate: choose the lens, set aside what does not fit, and choose again without it.

    Raises
    ------
    InputError : no such lens, or too few corners for it
    """
    asked = None if lens == AUTO else form(lens)
    kept, aside = list(views.views), list[tuple[str, float]]()
    while True:
        entry, compared = (asked, []) if asked else chosen(kept, views.size)
        found, more = fit_without_misfits(kept, entry, views.size)
        aside += more
        if not more or asked:
            break
        kept = list(found.views)
    return Study(views, found, tuple(aside), compared, _looped(found, views.size))


def chosen(views: Sequence[View], size: tuple[int, int]) -> tuple[Form, list[Comparison]]:
    """The form that held-out pictures call for; a usual one where there are too few."""
    try:
        return compare(views, FORMS, size)
    except InputError:
        return form(FEW), []


def _looped(found: CameraFit, size: tuple[int, int]) -> CameraTrace | None:
    """The loop from the pinhole on; None for a lens that is none, or too few pictures."""
    if found.form.lens != "brown":
        return None
    try:
        return trace(found.views, size)
    except (InputError, np.linalg.LinAlgError):
        return None


def as_json(done: Study) -> dict[str, object]:
    """The document of `sinan camera`."""
    found = done.found
    stds = [finite_or_none(value) for value in found.std]
    return {
        "format": 1,
        "camera": done.views.where,
        "size": list(done.views.size) if all(done.views.size) else None,
        "lens": found.form.lens,
        "form": found.form.name,
        "values": dict(zip(found.form.names, found.parameters.tolist(), strict=True)),
        "std": dict(zip(found.form.names, stds, strict=True)),
        "covariance": found.covariance.tolist() if np.all(np.isfinite(found.covariance)) else None,
        "undetermined": list(found.undetermined),
        "rms": found.rms,
        "sigma": found.sigma,
        "corners": sum(map(len, found.views)),
        "pictures": [
            {"name": view.name, "corners": len(view), "rms": float(rms), "r": pose.r.tolist(), "T": pose.T.tolist()}
            for view, rms, pose in zip(found.views, found.rms_of_view, found.poses, strict=True)
        ],
        "set_aside": [{"name": name, "rms": finite_or_none(rms)} for name, rms in done.aside],
        "without": [{"name": name, "why": why} for name, why in done.views.without.items()],
        "compared": [
            {
                "form": one.form.name,
                "parameters": len(one.form.names),
                "held_out_rms": one.rms,
                "behind": one.behind[0],
                "standard_error": one.behind[1],
            }
            for one in done.compared
        ],
        "trace": None if done.looped is None else document(done.looped),
    }


#: Digits after the point, by parameter; coefficients have six.
_PIXELS = ("f", "f_x", "f_y", "u0", "v0")


def value_words(name: str, value: float, std: float | None) -> tuple[str, str]:
    """Value and standard deviation as text, the same digits."""
    digits, unit = (2, " pixels") if name in _PIXELS else (6, "")
    return f"{value:.{digits}f}{unit}", "not determined" if std is None else f"{std:.{digits}f}{unit}"


def lens_words(name: str) -> str:
    """What a form of the lens is called in a sentence."""
    words = {"pinhole": "a pinhole without distortion", "fisheye": "a fisheye", "unified": "a unified lens (xi)"}
    return words.get(name, "an omnidirectional lens" if name == "omnidirectional" else f"a lens with {name}")


def summary(document: Mapping[str, Any]) -> list[str]:
    """The lines for the terminal."""
    pictures = document["pictures"]
    counted = f"{len(pictures)} pictures, {document['corners']} corners"
    lines = [f"{lens_words(document['form'])}: {counted}, {document['rms']:.3f} pixels RMS"]
    for name, value in document["values"].items():
        shown, std = value_words(name, value, document["std"][name])
        lines.append(f"  {name:4} {shown} ± {std}".replace(" pixels ±", " ±"))
    lines += [f"not determined: {sentence}" for sentence in document["undetermined"]]
    for one in document["set_aside"]:
        rms = "not seen by this camera" if one["rms"] is None else f"{one['rms']:.2f} pixels RMS"
        lines.append(f"set aside: {one['name']}, {rms}")
    lines += [f"left out: {one['name']}, {one['why']}" for one in document["without"]]
    for one in document["compared"]:
        lines.append(f"held out, {one['form']}: {one['held_out_rms']:.3f} pixels RMS")
    looped = document["trace"]
    if looped:
        lines.append(trace_words(looped))
        lines += [
            f"remains: {one['name']}, p-value {p_words(one['p_value'])}; {share(one, document):.0%} of the squares left"
            for one in looped["remaining"]
        ]
    return lines


def share(one: Mapping[str, Any], document: Mapping[str, Any]) -> float:
    """Share of the sum of squares that a candidate explains, of what is left."""
    dof = 2 * document["corners"] - 6 * len(document["pictures"])
    return float(one["statistic"] / (one["statistic"] + dof))


def p_words(p: float) -> str:
    """A p-value as text; what a float does not hold is below it."""
    return f"{p:.0e}" if p > 1e-300 else "below 1e-300"


def trace_words(looped: Mapping[str, Any]) -> str:
    """The verdict in a line."""
    error = looped["error"]
    change = f"{error['before']['rms']:.3f} -> {error['after']['rms']:.3f} pixels RMS on held-out pictures"
    if looped["verdict"] == "effects":
        return f"without distortion the residual shows `{looped['effects'][0]['name']}`: {change}"
    if looped["verdict"] == "no_effect":
        return "without distortion the residual shows nothing"
    return "without distortion the residual shows something that no effect of the catalogue explains"
