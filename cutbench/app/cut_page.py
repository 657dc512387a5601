"""The page of one cut: choose, see the estimate at once, run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from nicegui import events, ui

from cutbench.app import case_choices, drawings
from cutbench.app.case_choices import Choice, Slider
from cutbench.app.drawings import Curve
from cutbench.app.jobs import RUNNING, Job
from cutbench.app.page_parts import Bench, JobWatch, alert, choice, refusals, upload
from cutbench.app.tasks import SECTION, run
from cutbench.base.errors import BadInput
from cutbench.base.greek import plain_formula, subscripted
from cutbench.case.case import Case
from cutbench.case.motion import UNTIL
from cutbench.case.numerics import PRESETS
from cutbench.emulator.atlas import Estimate, NotInAtlas, shipped
from cutbench.run.files import read_run

_PARTS = {"parameters": "Material", "blade": "Blade", "specimen": "Specimen", "protocol": "Test"}
_UNTIL = dict(zip(UNTIL, ("the full depth", "the transition is known"), strict=True))
#: What is said of an estimate, by the names that it has for it.
_MEASURES = {
    "onset": "The cut begins at",
    "peak": "First largest force",
    "drop": "Then the force falls by",
    "steady": "Steady force",
}
#: Seconds between two estimates while a slider moves.
_THROTTLE_S = 0.1


class CutPage:
    """One person's choices and what is shown of them."""

    def __init__(self, bench: Bench):
        self._bench, self.choice = bench, Choice()
        self._materials, self._blades = bench.root / "materials", bench.root / "blades"
        self.case: Case = self.choice.case()
        self._estimate: Estimate | None = None
        self._fields: dict[str, ui.input] = {}
        self._kept: dict[str, Curve] = {}
        with ui.column().classes("w-full gap-2"):
            self._alert = alert().props("data-testid=fault")
            self._choosing()
            self._verdict = ui.label().classes("verdict").props("role=status data-testid=verdict")
            with ui.element("div").classes("two"):
                with ui.column().classes("w-full gap-2"):
                    self._answer()
                with ui.column().classes("w-full gap-1 beside"):
                    self._sliders()
                with ui.column().classes("w-full gap-2"):
                    self._run_controls()
        self._changed()

    # -- what is on the page --------------------------------------------------------------------------
    def _choosing(self) -> None:
        with ui.row().classes("w-full items-center"):
            known = case_choices.materials(self._materials)
            self._material = choice(known, self.choice.material, "Material", "material")
            self._material.on_value_change(self._new_material)
            blades = case_choices.blades(self._blades)
            self._blade = choice(blades, self.choice.blade, "Blade", "blade")
            self._blade.on_value_change(self._new_blade)
            ui.button("Material's values", on_click=self._reset).props("flat data-testid=reset")
        with ui.expansion("Materials and blades of your own").classes("w-full").props("data-testid=own"):
            ui.label(
                "The same TOML files as on the command line; a blade with a measured profile comes with its"
                " CSV file."
            )
            with ui.row().classes("w-full items-end"):
                self._upload("Load materials", self._materials, self._material)
                self._upload("Load blades", self._blades, self._blade)
                self._name = ui.input("Name").props("outlined dense data-testid=own-name")
                ui.button("Save material", on_click=lambda: self._save(self._materials)).props("outline")
                ui.button("Save blade", on_click=lambda: self._save(self._blades)).props("outline")
            self._written = ui.label().props("role=status data-testid=written")

    def _upload(self, label: str, into: Path, chosen: ui.select) -> None:
        def take(given: list[tuple[str, bytes]]) -> None:
            kept = case_choices.keep_case_files(into, given)
            self._offer()
            if kept:
                chosen.set_value(str(kept[-1]))

        upload(label, ".toml,.csv", take, self._alert)

    def _answer(self) -> None:
        self._measures = ui.row().classes("gap-x-6 gap-y-1 measures").props("data-testid=measures")
        self._plot = ui.plotly(drawings.force_figure([])).classes("w-full plot")
        self._plot.props('role=img aria-label="Force over blade travel"')
        with ui.row().classes("w-full items-center"):
            ui.button("PNG", on_click=self._save_png).props('outline aria-label="Save curves as PNG"')
            ui.button("CSV", on_click=self._save_csv).props('outline aria-label="Save curves as CSV"')
            self._earlier = choice([], [], "Earlier runs in the plot", "earlier", multiple=True)
            self._earlier.props("use-chips").classes("grow").on_value_change(self._draw_curves)

    def _run_controls(self) -> None:
        self._drawing = ui.html("", sanitize=False).classes("w-full")
        with ui.row().classes("w-full items-center"):
            numerics = choice([*PRESETS], self.choice.numerics, "Numerics", "numerics")
            until = choice(_UNTIL, self.choice.until, "Run until", "until")
            numerics.bind_value_to(self.choice, "numerics").on_value_change(self._changed)
            until.bind_value_to(self.choice, "until").on_value_change(self._changed)
            self._start = ui.button("Run it", on_click=self._run).props("data-testid=start")
        self._section = (
            ui.image().classes("section").props('fit=contain alt="Deformed section with the blade"')
        )
        self._section.set_visibility(False)
        self._watch = JobWatch(self._bench, ("run",), self._job_changed)
        with ui.expansion("Dimensionless groups").classes("w-full").props("data-testid=more-groups"):
            self._groups = ui.element("dl").classes("groups").props("data-testid=groups")
        self._offer()

    @ui.refreshable_method
    def _sliders(self) -> None:
        self._fields.clear()
        parts: dict[str, list[Slider]] = {}
        for slider in case_choices.sliders(self.choice.start()):
            parts.setdefault(slider.section, []).append(slider)
        for key, title in _PARTS.items():
            ui.label(title).classes("part").props("role=heading aria-level=2")
            for slider in (s for s in parts[key] if s.first):
                self._slider(slider)
            if rest := [s for s in parts[key] if not s.first]:
                with ui.expansion(f"More of the {title.lower()}").classes("w-full"):
                    for slider in rest:
                        self._slider(slider)

    def _slider(self, slider: Slider) -> None:
        q, title = slider.q, case_choices.plain_name(slider.q)
        unit = "" if q.unit == "1" else q.unit.replace("^2", "²")
        symbol = subscripted(q.symbol)
        with ui.element("div").classes("slider"):
            with ui.label(title).classes("name"):
                ui.html(f"<i>{symbol}</i>", tag="span", sanitize=False)
                ui.tooltip(q.doc)
            bar = ui.slider(min=0, max=1, step=0.002, value=slider.place(slider.value))
            bar.props(f'aria-label="{title}" data-testid=slide-{q.name}')
            box = ui.input(value=self.choice.texts.get(q.name, f"{slider.value:.6g}"))
            box.props(f'aria-label="{title}, {q.symbol}" data-testid=value-{q.name}')
            box.props(f'outlined dense inputmode=decimal suffix="{unit}"')
        self._fields[q.name] = box

        def slid(event: events.GenericEventArguments) -> None:
            box.set_value(f"{slider.at(event.args):.4g}")
            self._write(q.name, box.value)

        def typed(event: events.GenericEventArguments) -> None:
            self._write(q.name, str(event.args or ""))
            bar.set_value(slider.place(self.case.values[q.name] / q.factor))

        bar.on("update:model-value", slid, throttle=_THROTTLE_S)
        box.on("update:model-value", typed, throttle=2 * _THROTTLE_S, leading_events=False)

    def _write(self, name: str, text: str) -> None:
        self.choice.texts[name] = text
        self._changed()

    # -- what follows from a choice -------------------------------------------------------------------
    def _new_material(self) -> None:
        self.choice.material = str(self._material.value)
        self._reset()

    def _new_blade(self) -> None:
        self.choice.blade = str(self._blade.value)
        self._reset()

    def _reset(self) -> None:
        self.choice.texts.clear()
        with refusals(self._alert):
            self.choice.start()
            self._sliders.refresh()
            self._changed()

    def _changed(self) -> None:
        """Make the case of what is chosen, and say what a run of it would give."""
        wrong, self._estimate = "", None
        with refusals(self._alert):
            try:
                self.case = self.choice.case()
            except BadInput as error:
                wrong = error.key
                raise
            try:
                self._estimate = shipped().estimate(self.case)
                said = self._estimate.sentence()
                self._verdict.set_text(f"{said[0].upper()}{said[1:]}.")
            except NotInAtlas as error:
                beyond = f"the runs at hand hold {error.expected}, and {error.key} is {error.value}"
                self._verdict.set_text(f"No estimate: {beyond}. Run it.")
        for name, box in self._fields.items():
            box.props("error" if name == wrong else "", remove="" if name == wrong else "error")
        self._start.set_enabled(not self._alert.text)
        if self._alert.text:
            self._verdict.set_text("This cannot be cut as it stands.")
            return
        self._tell()
        self._draw_curves()

    def _tell(self) -> None:
        self._measures.clear()
        with self._measures:
            for name, text in self._estimate.lines() if self._estimate else ():
                if name in _MEASURES and text[0] != "-":
                    ui.label(f"{_MEASURES[name]}: {text}")
            for doubt in self.case.doubts:
                ui.label(doubt).classes("doubt")
        self._groups.clear()
        with self._groups:
            for name, value in self.case.groups().items():
                with ui.element("dt"):
                    ui.label(plain_formula(name))
                with ui.element("dd"):
                    ui.label(f"{value:.4g}")
        self._drawing.set_content(drawings.specimen_svg(self.case))

    # -- curves ---------------------------------------------------------------------------------------
    def _curves(self) -> list[Curve]:
        found = [Curve.of_estimate(self._estimate)] if self._estimate else []
        for path in self._earlier.value:
            if path not in self._kept:
                with refusals(self._alert):
                    result = read_run(self._bench.root / path)
                    name = f"{result.case.name}, {path}"
                    self._kept[path] = Curve(name, result.displacement_mm, result.force_N)
        found += [self._kept[path] for path in self._earlier.value if path in self._kept]
        job = self._watch.job
        if job is not None and job.state == RUNNING and job.points:
            mm, N = np.array([(0.0, 0.0), *job.points]).T
            found.append(Curve(f"{job.title}, running", mm, N))
        return found

    def _draw_curves(self) -> None:
        self._plot.update_figure(drawings.force_figure(self._curves()))

    def _save_png(self) -> None:
        ui.download.content(drawings.curves_png(self._curves()), "force.png")

    def _save_csv(self) -> None:
        ui.download.content(drawings.curves_csv(self._curves()), "force.csv")

    # -- runs and files -------------------------------------------------------------------------------
    def _run(self) -> None:
        with refusals(self._alert):
            folder = self._bench.place("run")
            self._watch.watch(self._bench.jobs.start("run", self.case.name, folder, run, self.case))

    def _job_changed(self, job: Job) -> None:
        picture = job.folder / SECTION
        self._section.set_visibility(picture.is_file())
        if picture.is_file():
            self._section.set_source(self._bench.address(picture))
        if job.state != RUNNING and (job.folder / "run.json").is_file():
            self._offer(job.folder.name)
        self._draw_curves()

    def _offer(self, newest: str = "") -> None:
        """Offer what is in the folder by now."""
        runs = self._bench.with_file("run.json")
        shown = [path for path in self._earlier.value if path in runs]
        shown += [newest] if newest in runs and newest not in shown else []
        self._earlier.set_options(runs, value=shown)
        self._material.set_options(case_choices.materials(self._materials))
        self._blade.set_options(case_choices.blades(self._blades))

    def _save(self, folder: Path) -> None:
        with refusals(self._alert):
            path = case_choices.save_case(self.case, str(self._name.value), folder)
            self._written.set_text(f"Written to {path}: cutbench run2d {path}")
            self._offer()
