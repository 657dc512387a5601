"""The page of sweeps and maps: begin one, watch it, open those that are there."""

from __future__ import annotations

from pathlib import Path

from nicegui import ui

from cutbench.app.cut_page import CutPage
from cutbench.app.jobs import RUNNING, Job
from cutbench.app.page_parts import Bench, JobWatch, alert, choice, refusals, upload
from cutbench.app.studies import ESTIMATE, WAYS, axis_choices, keep_study, write_study
from cutbench.app.tasks import estimate_map, run_map
from cutbench.base.errors import BadInput
from cutbench.maps.axes import GRID

#: A map begins with these axes, and a second axis may be none: a sweep.
_FIRST, _NO_AXIS = ("cohesion", "viscosity"), ""
#: Points along an axis of a grid, and the most runs of a search, to begin with.
_COUNTS = {GRID: 4}
_RUNS = 20


class MapsPage:
    """A form for a map of the cut that is chosen, and the maps of the folder."""

    def __init__(self, bench: Bench, cut: CutPage):
        self._bench, self._cut, self._case = bench, cut, cut.case
        with ui.column().classes("w-full gap-2"):
            self._alert = alert().props("data-testid=map-fault")
            self._form()
            self._picture = ui.image().classes("picture").props('fit=contain alt="The map as far as it is"')
            self._picture.set_visibility(False)
            self._watch = JobWatch(bench, ("map",), self._job_changed)
            self._none = ui.label("No map is in this folder yet.")
            with ui.row().classes("w-full items-center"):
                self._open = choice([], None, "Maps in the folder", "map").on_value_change(self._show)
            self._frame = ui.element("iframe").classes("frame").props('title="Map" data-testid=map-page')
        self.offer()

    def _form(self) -> None:
        said = "A map of {} as it is on the page Cut, with one or two quantities varied.".format
        ui.label().bind_text_from(self._cut, "case", lambda case: said(case.name))
        known = axis_choices(self._case)
        self._axes: list[tuple[ui.select, ui.input, ui.input]] = []
        for number, first in enumerate(_FIRST):
            options = {name: axis.title for name, axis in known.items()}
            with ui.row().classes("w-full items-center"):
                title = ("Across", "Up")[number]
                if number:
                    options = {_NO_AXIS: "nothing: one sweep", **options}
                chosen = choice(options, first, title, f"axis-{number}").classes("axis")
                low, high = (ui.input(text).props("outlined dense") for text in ("from", "to"))
                self._axes.append((chosen, low, high))
                chosen.on_value_change(lambda _, n=number: self._fill(n))
                self._fill(number)
        with ui.row().classes("w-full items-center"):
            self._way = choice(WAYS, ESTIMATE, "How", "way").on_value_change(self._count_fits)
            self._count = ui.number("Points along an axis", value=_RUNS, min=2, precision=0)
            self._count.props("outlined dense data-testid=count")
            ui.button("Map it", on_click=self._start).props("data-testid=start-map")
            upload("Load a study of your own", ".toml", self._take, self._alert)
        self._count_fits()

    def _fill(self, number: int) -> None:
        chosen, low, high = self._axes[number]
        axis = axis_choices(self._case).get(str(chosen.value))
        for box, end in ((low, axis and axis.low), (high, axis and axis.high)):
            box.set_value(f"{end:.3g}" if end else "")
            box.props(f'suffix="{axis.unit if axis and axis.unit != "1" else ""}"')
            box.set_enabled(axis is not None)

    def _count_fits(self) -> None:
        way = str(self._way.value)
        self._count.set_visibility(way != ESTIMATE)
        self._count.props(f'label="{"Points along an axis" if way == GRID else "Runs at the most"}"')
        self._count.set_value(_COUNTS.get(way, _RUNS))

    def _start(self) -> None:
        with refusals(self._alert):
            self._bench.jobs.check_free()
            known = axis_choices(self._cut.case)
            axes = [
                (known[str(chosen.value)], str(low.value), str(high.value))
                for chosen, low, high in self._axes
                if chosen.value != _NO_AXIS
            ]
            if len({axis.name for axis, *_ in axes}) < len(axes):
                raise BadInput("axis", axes[0][0].name, "two quantities, or nothing for the second")
            way, folder = str(self._way.value), self._bench.place("map")
            study = write_study(self._cut.case, axes, way, int(self._count.value or 0), folder)
            self._begin(study, way)

    def _take(self, given: list[tuple[str, bytes]]) -> None:
        self._bench.jobs.check_free()
        way = ESTIMATE if self._way.value == ESTIMATE else GRID
        text = given[0][1].decode("utf-8", errors="replace")
        self._begin(keep_study(self._bench.place("map"), text), way)

    def _begin(self, study: Path, way: str) -> None:
        task = estimate_map if way == ESTIMATE else run_map
        self._watch.watch(self._bench.jobs.start("map", study.parent.name, study.parent, task, study))

    def _job_changed(self, job: Job) -> None:
        if (job.folder / "map.html").is_file() and job.state != RUNNING:
            self._picture.set_visibility(False)
            self.offer(job.folder.name)
        elif (picture := job.folder / "phase.png").is_file():
            self._picture.set_visibility(True)
            self._picture.set_source(self._bench.address(picture))

    def offer(self, newest: str = "") -> None:
        """Offer the maps that are in the folder by now, with the newest open, and the axes of the case."""
        maps = self._bench.with_file("map.html")
        value = newest or self._open.value
        self._open.set_options(maps, value=value if value in maps else next(iter(maps), None))
        for part in (self._open, self._frame):
            part.set_visibility(bool(maps))
        self._none.set_visibility(not maps)
        self._show()
        if self._case != self._cut.case:
            self._case = self._cut.case
            for number in range(len(self._axes)):
                self._fill(number)

    def _show(self) -> None:
        if self._open.value is not None:
            page = self._bench.root / str(self._open.value) / "map.html"
            self._frame.props(f'src="{self._bench.address(page)}"')
