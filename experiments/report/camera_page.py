"""The page of a camera: intrinsics, the residual field before and after, the error of each picture, lenses compared."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sinan.calibration.cameras.camera import CameraFit
from sinan.experiments.camera.loop import CameraTrace
from sinan.experiments.camera.study import Study, lens_words, p_words, share, trace_words, value_words
from sinan.experiments.report.figures import AFTER, BEFORE, SOFT, new_figure
from sinan.experiments.report.page import Page
from sinan.sensors.camera import Intrinsics

#: The longest arrow of a residual field is drawn so long, as a share of the picture's width.
_ARROW = 0.06


def camera_page(path: Path, name: str, done: Study, document: Mapping[str, Any]) -> None:
    """Write the page."""
    found, pictures = done.found, len(done.kept)
    page = Page(
        f"{name}: a camera calibrated",
        f"{lens_words(found.form.name).capitalize()}, from {document['corners']} corners in {pictures} pictures.",
    )
    page.numbers(
        [
            (f"{found.rms:.3f}", "RMS distance of corners and prediction, pixels"),
            *(
                (f"{one['rms']:.2f}", f"the same of {one['name']}, set aside")
                for one in document["set_aside"]
                if one["rms"]
            ),
        ]
    )
    rows = [[key, *value_words(key, value, document["std"][key])] for key, value in document["values"].items()]
    page.table(["", "found", "1 sigma"], rows, (1, 2))
    for sentence in document["undetermined"]:
        page.text(f"Not determined: {sentence}.")
    if done.looped is not None:
        loop_section(page, done.looped, document)
    page.heading("Each picture")
    page.figure(of_each_picture(document), "RMS error of each picture by this camera; what was set aside took no part.")
    for one in document["without"]:
        page.text(f"Left out: {one['name']}, {one['why']}.")
    if done.compared:
        page.heading("Which lens the pictures call for")
        page.text(
            "Every fifth picture is held out at a time: a camera calibrated without it predicts its corners, its pose "
            "being fitted. The simplest lens within one standard error of the best is taken."
        )
        caption = "RMS error of held-out pictures by lens, on a logarithmic scale; blue: taken."
        page.figure(of_each_form(document), caption)
        compared = [
            [
                one["form"],
                str(one["parameters"]),
                f"{one['held_out_rms']:.4f}",
                f"{one['behind']:.1f} ± {one['standard_error']:.1f}",
            ]
            for one in document["compared"]
        ]
        taken = [k for k, one in enumerate(document["compared"]) if one["form"] == found.form.name]
        head = ["lens", "parameters", "held out, pixels RMS", "log density behind the best"]
        page.table(head, compared, (1, 2, 3), marked=taken)
    page.write(path)


def loop_section(page: Page, looped: CameraTrace, document: Mapping[str, Any]) -> None:
    """What a calibration without distortion leaves, and what explains it."""
    page.heading("What a pinhole leaves")
    line = trace_words(document["trace"])
    page.text(f"{line[0].upper()}{line[1:]}.")
    page.figure(
        residual_fields(looped.before, looped.after),
        "Residual, predicted minus seen, of every corner of every picture, where it lies in the picture: before, "
        "calibrated as a pinhole, and after. Each panel says how much its arrows are lengthened.",
    )
    if looped.named is not None:
        page.figure(
            distortion_over_radius(looped.after),
            "How far the lens moves a point along the radius; the band is 1 sigma.",
        )
    rows = [
        [one["name"], f"{one['statistic']:.1f}", str(one["dof"]), p_words(one["p_value"])]
        for one in document["trace"]["candidates"]
    ]
    page.table(["what would explain the pinhole's residual", "chi-square", "parameters", "p-value"], rows, (1, 2, 3))
    for one in document["trace"]["remaining"]:
        page.text(
            f"Remains: {one['name']} (p-value {p_words(one['p_value'])}). It explains {share(one, document):.0%} of "
            "the squares that are left, and no effect of the catalogue does."
        )


def residual_fields(before: CameraFit, after: CameraFit) -> Figure:
    """Two residual fields side by side, each with arrows of its own scale."""
    figure, axes = new_figure(1, 2, 3.6, sharex=True, sharey=True)
    for one, fit, colour, title in zip(axes[0], (before, after), (BEFORE, AFTER), ("before", "after"), strict=True):
        seen, residual = np.concatenate([v.pixels for v in fit.views]), np.concatenate(fit.residual)
        width = float(np.ptp(seen[:, 0]))
        lengthened = _ARROW * width / max(float(np.quantile(np.linalg.norm(residual, axis=1), 0.99)), 1e-9)
        lengthened = float(f"{lengthened:.1g}")
        one.quiver(
            *seen.T, *residual.T, angles="xy", scale_units="xy", scale=1.0 / lengthened, color=colour, width=0.0025
        )
        one.set_title(f"{title}: {fit.rms:.3f} pixels RMS, arrows {lengthened:g} times", loc="left", fontsize=9)
        one.set_aspect("equal")
        one.set_xlabel("u / pixels", fontsize=9)
    axes[0, 0].set_ylabel("v / pixels", fontsize=9)
    axes[0, 0].invert_yaxis()
    return figure


def distortion_over_radius(found: CameraFit) -> Figure:
    """f (radial(r) - 1) r over the radius of the corners, with the band that the covariance gives."""
    camera, names = found.intrinsics, list(found.form.names)
    seen = np.concatenate([view.pixels for view in found.views])
    reach = float(np.max(np.linalg.norm(seen - camera.centre, axis=1)) / camera.f.mean())
    ray = np.column_stack([np.linspace(0.0, reach, 80), np.zeros(80), np.ones(80)])
    k = np.where(np.isin(camera.model.coefficients, ["p1", "p2"]), 0.0, camera.k)
    radial = Intrinsics(camera.f, camera.centre, "brown", k)
    moved = radial.pixels(ray)[:, 0] - Intrinsics(camera.f, camera.centre).pixels(ray)[:, 0]
    free = [names.index(name) for name in found.form.free]
    slopes = (radial.slopes(ray)[1] @ found.form.spread)[:, 0, free]
    sigma = np.sqrt(np.einsum("ni,ij,nj->n", slopes, found.covariance[np.ix_(free, free)], slopes))
    figure, axes = new_figure(1, 1, 2.8)
    one, radius = axes[0, 0], ray[:, 0] * camera.f[0]
    one.fill_between(radius, moved - sigma, moved + sigma, color=AFTER, alpha=0.25, lw=0)
    one.plot(radius, moved, color=AFTER, lw=1.6)
    one.axhline(0.0, color=SOFT, lw=0.9)
    one.set_xlabel("radius without distortion / pixels", fontsize=9)
    one.set_ylabel("moved outwards / pixels", fontsize=9)
    return figure


def of_each_picture(document: Mapping[str, Any]) -> Figure:
    """Bars of the RMS of each picture; those set aside in another colour."""
    entries = [(one["name"], one["rms"], AFTER) for one in document["pictures"]]
    entries += [(one["name"], one["rms"] or 0.0, BEFORE) for one in document["set_aside"]]
    entries.sort()
    figure, axes = new_figure(1, 1, 0.22 * len(entries) + 0.9)
    one = axes[0, 0]
    y = np.arange(len(entries))[::-1]
    one.barh(y, [rms for _, rms, _ in entries], color=[colour for *_, colour in entries], height=0.65)
    one.set_yticks(y, [name for name, *_ in entries], fontsize=8)
    one.set_xlabel("RMS / pixels (red: set aside)" if document["set_aside"] else "RMS / pixels", fontsize=9)
    return figure


def of_each_form(document: Mapping[str, Any]) -> Figure:
    """Points of the held-out error of each lens."""
    figure, axes = new_figure(1, 1, 0.28 * len(document["compared"]) + 0.9)
    one = axes[0, 0]
    for y, entry in enumerate(reversed(document["compared"])):
        one.plot(entry["held_out_rms"], y, "o", ms=7, color=AFTER if entry["form"] == document["form"] else SOFT)
    one.set_yticks(range(len(document["compared"])), [entry["form"] for entry in reversed(document["compared"])])
    one.set_ylim(-0.6, len(document["compared"]) - 0.4)
    one.set_xscale("log")
    one.xaxis.set_major_formatter("{x:g}")
    one.xaxis.set_minor_formatter("{x:g}")
    one.tick_params(axis="x", which="minor", labelsize=8)
    one.set_xlabel("held out: RMS / pixels", fontsize=9)
    return figure
