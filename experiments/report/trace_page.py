"""The page of a trace: verdict, each effect on its own sensor, error held out, evidence, what could not be seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sinan.estimator.evidence.term import Term
from sinan.experiments.autopilots.parameters import parameter_value
from sinan.experiments.report import trace_figures as figures
from sinan.experiments.report import trace_words, verdict_words, words
from sinan.experiments.report.assumption_table import assumption_table
from sinan.experiments.report.page import Drawn, Page
from sinan.experiments.report.trace_figures import Bar
from sinan.experiments.residual_loop.report import held_out_part
from sinan.experiments.residual_loop.trials import ROLLED_BACK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sinan.estimator.evidence.source import Fit, Source, StreamResidual
    from sinan.experiments.residual_loop.traced import Part, Traced
    from sinan.experiments.residual_loop.trials import Finding
    from sinan.experiments.residual_loop.verdict import Named

#: Candidates that the chart and the table show unfolded.
_SHOWN = 12
_LN10 = float(np.log(10.0))
#: Of the RMS of a flight's innovations.
_WEIGHT = " In the RMS each reading has the weight that its predicted variance gives it."


def trace_figures(traced: Traced, document: Mapping[str, Any]) -> dict[str, tuple[Figure, str]]:
    """The figures of a trace by name, each with its caption: `effect_1` ... in order of discovery."""
    made: dict[str, tuple[Figure, str]] = {}
    for part in traced.parts:
        several = f"_{part.sensor}" if len(traced.parts) > 1 else ""
        if part.trace.verdict.reported:
            made |= {name + several: drawn for name, drawn in _error_figures(part).items()}
        elif not verdict_words.reported(document):
            made[f"residuals{several}"] = _noise_figure(part)
    for k, named in enumerate(traced.verdict.effects):
        drawn_effect = _effect_figure(traced.part_of(named), named.finding)
        if drawn_effect is not None:
            made[f"effect_{k + 1}"] = drawn_effect
    bars = evidence(traced)
    if bars:
        made["candidates"] = _evidence_figure(bars, document)
    return made


def trace_page(
    path: Path,
    traced: Traced,
    document: Mapping[str, Any],
    hidden: Mapping[str, Sequence[float]] | None = None,
    review: Drawn | None = None,
) -> None:
    """Write the page of a trace.

    Parameters
    ----------
    document : the report with its words
    hidden : of a simulated recording, the effects that are in it: shown with what was found
    review : the recording over time
    """
    page = _head(document)
    made = trace_figures(traced, document)
    if verdict_words.reported(document) and not document["twins"]:
        _numbers(page, document)
    if document["twins"]:
        _twin_table(page, document)
    if document["effects"]:
        page.heading("What was found")
        for k, named in enumerate(traced.verdict.effects):
            _effect_section(page, traced, document, named, k, made.get(f"effect_{k + 1}"), hidden or {})
    page.heading("Error before and after" if verdict_words.reported(document) else "Residual of the plain model")
    for name in [n for n in made if n.startswith(("residuals", "errors"))]:
        page.figure(*made[name])
    _budget_table(page, document)
    _reference_table(page, document)
    if review is not None:
        page.heading("The log over time")
        page.part(review)
    if "candidates" in made:
        page.heading("Evidence for every candidate")
        page.figure(*made["candidates"])
        _candidate_tables(page, traced, document)
    _honesty(page, document)
    assumption_table(page, document)
    page.write(path)


def _head(document: Mapping[str, Any]) -> Page:
    """A page that begins with the verdict, what to do next, what the log was, and what it could not tell."""
    page = Page(document["headline"], f"{verdict_words.name_of(document)}. {verdict_words.lead(document)}")
    page.verdict(_in_a_word(document), "unseen" if verdict_words.shows_nothing(document) else document["verdict"])
    _found_table(page, document)
    page.text(f"Verdict `{document['verdict']}`: {document['says']}.")
    if document["verdict"] == "unexplained" and document["remaining"]:
        page.items([f"{_capital(trace_words.remaining_sentence(item))}." for item in document["remaining"]])
    page.text(f"What to do next: {document['next']}.")
    if document.get("autopilot"):
        _autopilot(page, document)
    for warning in document.get("warnings", []):
        page.text(f"Warning: {warning}.")
    page.contents()
    page.rests_on(document.get("logs", []), [("risk of a false finding", f"{document['alpha']:g}")])
    if document.get("notes"):
        with page.folded("What the log does not declare, and was estimated from it"):
            page.items([str(note) for note in document["notes"]])
    if document.get("not_seen"):
        with page.folded("What this log could not show"):
            page.items(document["not_seen"])
    return page


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _in_a_word(document: Mapping[str, Any]) -> str:
    """The verdict in a word or two, for the coloured mark."""
    if document["verdict"] == "effects":
        return f"{words.counted(len(verdict_words.reported(document)), 'effect')} found"
    if verdict_words.shows_nothing(document):
        return "nothing could be seen"
    return "no effect found" if document["verdict"] == "no_effect" else str(document["verdict"])


def _found_table(page: Page, document: Mapping[str, Any]) -> None:
    """What was found, how large, how sure: a row an effect."""
    if not document["effects"]:
        return
    rows = [
        [
            f"{one['summary'].rstrip('.')} ({one['name']})",
            trace_words.size_and_sigma(one),
            words.p_value_words(one["log10_p_value"]),
            _check(one),
        ]
        for one in document["effects"]
    ]
    page.table(["effect", "size", "by chance", f"check on the {document['error']['held_out_part']}"], rows)


def _check(effect: Mapping[str, Any]) -> str:
    """What held-out data say of an effect, for a cell of a table."""
    held = effect.get("held_out")
    if effect["predicts"] is None or not held:
        return "cannot be checked"
    failed = "" if effect["predicts"] else f" ({trace_words.NOT_PREDICTING})"
    return f"{words.SENSORS.get(held['stream'], held['stream'])} residual {verdict_words.sizes(held)}{failed}"


def _autopilot(page: Page, document: Mapping[str, Any]) -> None:
    """The parameters to type in, and what has none."""
    terms = document["autopilot"]
    page.subheading("Parameters to set in the flight controller")
    if terms["parameters"]:
        page.text("Type these in at the ground station, or load the file. Then fly again, and trace the new log.")
        if terms["call"] and terms["call"] not in document["next"]:
            page.text(f"`{terms['call']}` writes the file.")
        rows = [
            [
                one["name"],
                parameter_value(one["value"], one["whole"]),
                "-" if one["was"] is None else parameter_value(one["was"], one["whole"]),
                ", ".join(one["effects"]),
            ]
            for one in terms["parameters"]
        ]
        page.table(["parameter", "set to", "was", "corrects"], rows, numeric=(1, 2))
    for one in terms["without"]:
        page.text(f"No parameter for {one['effect']}: {one['why']}.")
    for remark in terms["notes"]:
        page.text(f"{remark[0].upper()}{remark[1:]}.", note=True)


# ---- figures


def _noise_figure(part: Part) -> tuple[Figure, str]:
    streams = part.source.residuals(part.trace.final)
    known = part.source.noise_known
    scale = 1.0 if known else float(np.sqrt(np.mean(np.concatenate([r.whitened[r.tells] for r in streams]) ** 2)))
    sigma = "what the noise levels of the sensors predict" if known else "its own spread, since no noise is declared"
    return (
        figures.residuals_like_noise(streams, scale),
        f"Residuals divided by σ, {sigma}. Pure noise scatters evenly about zero and follows the black curve.",
    )


def _error_figures(part: Part) -> dict[str, tuple[Figure, str]]:
    """Residuals before and after of every stream that an effect reported enters, and the errors."""
    verdict, words_of_part = part.trace.verdict, held_out_part(part)
    before, after = (_by_stream(part.source, fit) for fit in (part.trace.selection.plain, part.trace.final))
    streams = [_stream_of(part, finding) for finding in verdict.reported]
    made, shaded = {}, "" if part.source.is_predicting else words_of_part
    for stream in dict.fromkeys([verdict.proof.stream, *streams]):
        if stream not in before:
            continue
        terms = [f.term for f, s in zip(verdict.reported, streams, strict=True) if s == stream]
        intervals = [term.interval for term in terms if term.interval is not None]
        name = "residuals" if stream == verdict.proof.stream else f"residuals_{stream}"
        caption = (
            f"Residual (reading minus prediction) of the {words.SENSORS.get(stream, stream)}, fitted to all data."
            + (_WEIGHT if before[stream].variance is not None else "")
            + (" Yellow: while the effect acts." if intervals else "")
        )
        made[name] = figures.residuals_over_time(before[stream], after[stream], shaded, intervals), caption
    proof = verdict.proof
    of_all, held = (proof.in_sample_before, proof.in_sample_after), (proof.before, proof.after)
    caption = "The proof is the upper pair: errors on data to which these models were not fitted. Black: 95 % interval."
    twins = {twin.named.finding.term.name for twin in verdict.twins}
    taken = [finding.term.name for finding in verdict.reported if finding.term.name in twins]
    if taken:
        caption += f" Of the effects that these data cannot tell apart, the model has {' and '.join(taken)}."
    made["errors"] = figures.error_bars(of_all, held, words_of_part, proof.stream), caption
    return made


def _by_stream(source: Source, fit: Fit) -> dict[str, StreamResidual]:
    return {r.stream: r for r in source.residuals(fit)}


def _stream_of(part: Part, finding: Finding) -> str:
    """The stream in whose residuals an effect shows: its own, or for an IMU the one that sees most of it."""
    own, plain = finding.term.effect.stream, part.trace.selection.plain
    if own in _by_stream(part.source, plain):
        return own
    signature = part.source.signature(plain, finding.term, finding.beta)
    return own if signature is None else signature.stream


def _effect_figure(part: Part, finding: Finding) -> tuple[Figure, str] | None:
    source, selection = part.source, part.trace.selection
    step = next((s for s in reversed(selection.steps) if s.term == finding.term), None)
    signature = None if step is None else source.signature(step.before, finding.term, finding.beta)
    if step is None or signature is None:
        return None
    name = finding.term.name
    own = finding.term.effect.stream
    where = (
        ""
        if signature.stream == own
        else f" It shows most in the {words.SENSORS.get(signature.stream, signature.stream)}."
    )
    if finding.term.interval is not None:
        final = part.trace.final if finding.term in part.trace.final.terms else selection.final
        before, after = (_by_stream(source, fit)[signature.stream] for fit in (step.before, final))
        figure = figures.effect_over_time(before, after, name, finding.term.interval)
        is_last = selection.steps[-1].term == finding.term
        return figure, f"{_local_caption(before, after, finding.term, is_last)}{where}"
    return (
        figures.residual_against_effect(signature, name),
        f"Each dot is a reading: its residual before {name} was added, against what {name} predicts for it. Dots along "
        f"the line are explained by it; a round cloud would be noise.{where}",
    )


def _local_caption(before: StreamResidual, after: StreamResidual, term: Term, is_last: bool) -> str:
    """What to look at in the figure of a time-localised effect: its readings, and what the others gain.

    Parameters
    ----------
    is_last : no other effect was added after it, so what the others gain is its doing
    """
    before = before.as_sure_as(after)
    masks = [term.covers(r.t) for r in (before, after)]
    parts = [(masks, "the yellow part"), ([~mask for mask in masks], "all the rest")]
    rms = {
        part: [r.rows(mask).weighed.rms for r, mask in zip((before, after), keep, strict=True)]
        for keep, part in parts
        if all(np.any(mask) for mask in keep)
    }
    unit = words.stream_unit(before.stream, before.unit)
    sizes = " and ".join(f"{f'{words.change(*pair)} {unit}'.strip()} in {part}" for part, pair in rms.items())
    text = f"The residual around the interval, before {term.name} was added and in the final model: RMS {sizes}."
    text += _WEIGHT if before.variance is not None else ""
    if is_last and len(rms) == 2 and rms["all the rest"][1] < rms["all the rest"][0]:
        text += (
            f" Without {term.name} the whole model is pulled towards the yellow readings, at the cost of the others: "
            "single ones may get worse with it, perhaps those next to the yellow part, but together they get better."
        )
    return text


def step_of(part: Part, finding: Finding) -> int:
    """At which step an effect was chosen, from 1 on; its place among the findings where its interval has moved."""
    taken = [step.term for step in part.trace.selection.steps]
    present = [other.term for other in part.trace.selection.findings]
    return (taken if finding.term in taken else present).index(finding.term) + 1


def evidence(traced: Traced) -> list[Bar]:
    """Evidence for what was found at the step at which it was chosen, for all else about the last model."""
    found = []
    for named in traced.verdict.effects:
        finding, failed = named.finding, named.predicts is False
        mark = trace_words.NOT_PREDICTING if failed else f"step {step_of(traced.part_of(named), finding)}"
        kind = "left" if failed else "found"
        found.append(Bar(f"{finding.term.name} ({mark})", finding.log_p / _LN10, kind))
    names = {named.finding.term.name for named in traced.verdict.effects}
    others = [
        Bar(
            (f"another {one.term.name}" if one.term.name in names else one.term.name)
            + (f" ({trace_words.REFUSED[one.why][0]})" if one.why else ""),
            one.log_p / _LN10,
            "left" if one.why else "other",
        )
        for one in traced.judged
    ]
    return found + others


def _evidence_figure(bars: Sequence[Bar], document: Mapping[str, Any]) -> tuple[Figure, str]:
    found = [bar for bar in bars if bar.kind == "found"]
    others = [bar for bar in bars if bar.kind != "found"]
    shown = [*found, *others[: max(_SHOWN - len(found), 3)]]
    if found:
        caption = (
            "Blue: what was found, with the step of the search. Grey: every other effect, tested once those are in the "
            "model: none of them passes the dashed line."
        )
    else:
        beside = " given the error that none of them explains" if document["verdict"] == "unexplained" else ""
        caption = f"Every candidate{beside}: none reaches the dashed line."
    if any(bar.kind == "left" for bar in others):
        caption = caption.split(": none")[0].rstrip(".") + (
            ". Orange: passes the line but was not accepted, for the reason in brackets: "
            f"{'; '.join(_reasons(others))}."
        )
    for effect in document["effects"]:
        if effect["confused_with"]:
            caption += f" {', '.join(effect['confused_with'])} would explain the data as well as {effect['name']}."
    hidden = len(bars) - len(shown)
    if hidden:
        caption += f" The {hidden} weakest are listed below."
    return figures.evidence_bars(shown, -float(np.log10(document["p_value_needed"]))), caption


def _reasons(bars: Sequence[Bar]) -> list[str]:
    """What the reasons in the brackets of these bars mean."""
    reasons = [*trace_words.REFUSED.values(), (trace_words.NOT_PREDICTING, "the held-out error does not fall with it")]
    return [f"{mark}, {why}" for mark, why in reasons if any(f"({mark})" in b.label for b in bars)]


# ---- sections


def _numbers(page: Page, document: Mapping[str, Any]) -> None:
    cards = []
    for error, _ in verdict_words.errors(document):
        part, sensor = error["held_out_part"], words.SENSORS.get(error["stream"], error["stream"])
        cards.append((verdict_words.residual_change(error), f"RMS of the {sensor} residual, {part}"))
        held = verdict_words.errors_against_a_truth(error)
        asked = verdict_words.part_of_reference(error)
        cards += [(change, f"{name}, {asked}") for name, change in held.items()]
    page.numbers(cards)


def _effect_section(
    page: Page,
    traced: Traced,
    document: Mapping[str, Any],
    named: Named,
    k: int,
    figure: tuple[Figure, str] | None,
    hidden: Mapping[str, Sequence[float]],
) -> None:
    effect = document["effects"][k]
    page.subheading(f"{effect['name']}: {effect['summary'].rstrip('.')}")
    rows = [list(row) for row in trace_words.parameter_rows(effect)]
    head = ["parameter", "value ± 1 sigma", "unit"]
    if effect["name"] in hidden:
        head.append("hidden in the data")
        rows = [[*row, f"{value:g}"] for row, value in zip(rows, hidden[effect["name"]], strict=True)]
    page.table(head, rows, numeric=(1, 3))
    step = step_of(traced.part_of(named), named.finding)
    text = f"Evidence: {words.p_value_words(effect['log10_p_value'])}, how often chance alone would show as much "
    text += f"(needed: p < {document['p_value_needed']:.2g}); found at step {step} of the search."
    if effect.get("interval"):
        from_0 = " (counted from 0)" if effect["interval_unit"] == "reading" else ""
        text += f" It acts {trace_words.interval_words(effect)}{from_0}."
    if together := trace_words.known_together(effect):
        text += f" {together}"
    if effect["confused_with"]:
        text += f" The data cannot tell it from {', '.join(effect['confused_with'])}."
    if effect["predicts"] is False:
        text += f" {verdict_words.not_predicting_sentence(document, effect)}"
    elif effect["predicts"]:
        held_out = verdict_words.stream_change(effect["held_out"])
        text += f" Check on held-out data: added to everything else that was found, the {held_out}."
    elif effect["name"].endswith(".outliers"):
        text += " Such readings are left out of the errors: nothing can predict them."
    else:
        text += " It acts on no held-out reading, so only this evidence speaks for it, not a held-out error."
    page.text(text)
    if figure is not None:
        page.figure(*figure)


def _twin_table(page: Page, document: Mapping[str, Any]) -> None:
    """Every effect that explains the data equally well, with the errors of the model that has it."""
    page.heading("Effects that these data cannot tell apart")
    page.text(f"Errors on the {document['error']['held_out_part']} of the data, without and with each of them:")
    errors = [verdict_words.twin_errors(twin) for twin in document["twins"]]
    head = list(dict.fromkeys(name for one in errors for name in one))
    rows = []
    for twin, known in zip(document["twins"], errors, strict=True):
        failed = f" ({trace_words.NOT_PREDICTING})" if twin["predicts"] is False else ""
        sizes = [f"{twin['name']}{failed}", trace_words.size_and_sigma(twin)]
        rows.append(sizes + [known.get(name, "-") for name in head])
    page.table(["effect", "size", *head], rows)


def _budget_table(page: Page, document: Mapping[str, Any]) -> None:
    """Where the plain model's error goes, by stream."""
    if not document.get("budget"):
        return
    page.heading("Parts of the plain model's error")
    page.text(
        "Shares of the mean square of the plain model's residual, one step ahead: removed by the effects that were "
        "found; white noise of the sensor; its slow noise; uncertainty of the estimated motion; and the unexplained "
        "rest. Each reading has the weight that its predicted variance gives it. The last column "
        "is the mean square that noise and motion predict, over the one that is left: far above 1, the noise was "
        "taken for larger than it is."
    )
    keys = ("effects", "white", "colour", "motion", "unnamed")
    rows = [
        [
            words.SENSORS.get(one["stream"], one["stream"]),
            f"{words.number(one['rms'])} {one['unit']}",
            *(f"{100.0 * one[key]:.0f} %" for key in keys),
            words.number(one["predicted"]),
        ]
        for one in document["budget"]
    ]
    head = ["sensor", "RMS before", "effects", "white noise", "slow noise", "motion", "unexplained", "predicted"]
    page.table(head, rows, numeric=tuple(range(1, 8)))


def _reference_table(page: Page, document: Mapping[str, Any]) -> None:
    whole = verdict_words.reference_changes(document["error"].get("truth"))
    if not whole or document["twins"] or not verdict_words.reported(document):
        return
    held = verdict_words.reference_changes(document["error"].get("truth_held_out"))
    page.text(
        f"Compared with {words.reference_words(document['error']['truth'].get('kind'))}, which nothing above has used:"
    )
    asked = verdict_words.part_of_reference(document["error"])
    head = ["", "all data, before → after", f"{asked}, before → after"]
    page.table(head, [[name, change, held.get(name, "-")] for name, change in whole.items()], (1, 2))
    truth = document["error"]["truth"]
    if note := words.reference_note(truth, truth["before"]):
        page.text(note, note=True)


def _candidate_tables(page: Page, traced: Traced, document: Mapping[str, Any]) -> None:
    known = {c["name"]: c for c in document["candidates"]}
    found = [
        [e["name"], f"found: {_p(e['log10_p_value'])}", "found" if e["predicts"] is not False else "does not predict"]
        for e in document["effects"]
    ]
    rows = []
    for one in traced.judged:
        name = one.term.name
        if one.why:
            seen = f"not accepted: {trace_words.REFUSED[one.why][1]}"
        elif one.term.interval is not None or name not in known:
            seen = "its interval is searched"
        else:
            seen = trace_words.detectable_words(known[name]) or "not visible in these data"
        rows.append([name, _p(one.log_p / _LN10), seen])
    unseen = [o.term.name for part in traced.parts for o in part.trace.selection.last_options if o.dof == 0]
    rows += [[name, "-", "not visible in these data"] for name in unseen]
    head = ["effect", "p-value", "would be found from"]
    if not found:
        page.text("What would have been seen: the size from which on each effect would have been found in these data.")
        page.table(head, rows[:_SHOWN], numeric=(1,))
        rows = rows[_SHOWN:]
    if found or rows:
        title = f"All {len(found) + len(rows)} candidates" if found else f"The other {len(rows)} candidates"
        with page.folded(f"{title}: p-values and the smallest sizes that would be found"):
            page.table(head, [*found, *rows], numeric=(1,))


def _p(log10_p: float) -> str:
    return f"{10.0**log10_p:.2g}" if log10_p > -4.0 else f"10^{log10_p:.0f}"


def _what_remains(document: Mapping[str, Any]) -> list[str]:
    """What the residual still has, or that it looks like noise; what passed its test and is not in the model."""
    left = list(document["rolled_back"])
    texts = [
        f"{name} passed the test on all data, but {trace_words.REFUSED[ROLLED_BACK][1]}: it may be chance, and is not "
        "in the model"
        for name in left
    ]
    failed = [str(effect["name"]) for effect in verdict_words.not_predicting(document)]
    texts += [f"{name} passed the test on all data, does not predict, and is not in the model" for name in failed]
    if document["remaining"]:
        return texts + [trace_words.remaining_sentence(item) for item in document["remaining"]]
    noise = "the remaining residual is white, and as large as the noise"
    beside = f"apart from what {' or '.join([*left, *failed])} would explain, " if texts else "nothing: "
    return [*texts, f"{beside}{noise}"]


def _honesty(page: Page, document: Mapping[str, Any]) -> None:
    """What could not be seen, and why."""
    page.heading("What remains")
    error = document["error"]
    if document["effects"] and error["same_names_on_fitting_part"] is not None:
        same = "the same" if error["same_names_on_fitting_part"] else "other"
        page.text(f"Fitted to one part of the data alone, the search chooses {same} effects.")
    for text in _what_remains(document):
        page.text(f"{_capital(text)}.")
    for one in document["left_out"]:
        page.text(f"The {words.SENSORS[one['sensor']]} was not traced: {one['why']}.")
