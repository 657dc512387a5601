"""The page of measured curves: drop a campaign or readings, fit them, ask what the model lacks."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path

from nicegui import ui

from cutbench.app.campaigns import (
    KINDS,
    ROLES,
    column_names,
    keep_file,
    likely_columns,
    sizes_of,
    write_campaign,
)
from cutbench.app.case_choices import Choice, blades, materials
from cutbench.app.jobs import Job
from cutbench.app.page_parts import Bench, JobWatch, alert, choice, refusals, upload
from cutbench.app.tasks import run_discovery, run_fit
from cutbench.base.figure_style import svg_of
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign, load_campaign
from cutbench.data.columns import UNITS
from cutbench.data.contact import TAKEN_OFF

_TASKS = {"fit": run_fit, "discover": run_discovery}
_ZERO = {"": "at zero, as recorded", "auto": "found in the curve"}
_REST = {"": "zero, as recorded", "auto": "found before contact"}


class DataPage:
    """Files, what is said of them, and what a fit or a discovery has found so far."""

    def __init__(self, bench: Bench):
        self._bench, self._folder = bench, bench.root / "readings"
        self._heads: dict[str, list[str]] = {}
        self._columns: dict[str, ui.select] = {}
        self._units: dict[str, ui.input] = {}
        self._sizes: dict[str, dict[str, ui.input]] = {}
        with ui.element("div").classes("two"):
            with ui.column().classes("w-full gap-2"):
                self._alert = alert().props("data-testid=data-fault")
                self._form()
                with ui.row():
                    ui.button("Draw", on_click=self._draw).props("outline data-testid=draw")
                    ui.button("Fit", on_click=lambda: self._begin("fit")).props("data-testid=fit")
                    ui.button("Discover what is missing", on_click=lambda: self._begin("discover")).props(
                        "data-testid=discover"
                    )
            with ui.column().classes("w-full gap-2"):
                self._watch = JobWatch(bench, tuple(_TASKS), self._job_changed)
                self._stages = ui.element("ol").classes("stages").props('aria-label="What was done"')
                self._picture = ui.image().classes("picture").props("fit=contain data-testid=found-picture")
                self._picture.props('alt="The curves: measured, and computed as soon as they are"')
                self._picture.set_visibility(False)
        self._frame = (
            ui.element("iframe").classes("frame").props('title="What was found" data-testid=found-page')
        )
        self._frame.set_visibility(False)

    def _form(self) -> None:
        ui.label(
            "Drop a campaign file with its tables, or tables of readings alone: CSV or text, one for each"
            " specimen or speed."
        )
        with ui.row().classes("w-full items-center"):
            upload("Choose files", ".csv,.txt,.tsv,.dat,.toml", self._take, self._alert, drop=True)
        with ui.row().classes("w-full items-center no-wrap"):
            self._names = ui.label().props("data-testid=kept")
            self._over = ui.button("Start over", on_click=self._forget).props("flat dense")
        self._head = ui.label().classes("head").props("tabindex=0")
        with ui.column().classes("w-full gap-2") as self._about:
            with ui.row().classes("w-full"):
                self._kind = choice(KINDS, "cut", "Test", "kind").on_value_change(
                    lambda: self._fields.refresh()
                )
                known, own = materials(self._bench.root / "materials"), blades(self._bench.root / "blades")
                self._like = choice(known, "gelatin", "Material to begin with", "like")
                self._tool = choice(own, "", "Blade", "tool")
                for each in (self._like, self._tool):
                    each.on_value_change(lambda: self._fields.refresh())
            self._fields()
            with ui.row().classes("w-full"):
                self._speed = ui.input("Speed, where no column has the time", placeholder="0.5 mm/s")
                self._speed.props("outlined dense data-testid=speed").classes("wide")
                self._zero = choice(_ZERO, "", "Contact", "contact-at")
                self._rest = choice(_REST, "", "Force at rest", "force-at-rest")
        self._forget()

    @ui.refreshable_method
    def _fields(self) -> None:
        kind, head = str(self._kind.value), next(iter(self._heads.values()), [])
        likely, titles = likely_columns(head, kind), column_names(head)
        self._columns.clear()
        self._units.clear()
        self._sizes.clear()

        def field(label: str, text: str, hint: str, mark: str) -> ui.input:
            made = ui.input(label, value=text, placeholder=hint)
            return made.props(f"outlined dense data-testid={mark}").classes("w-40")

        ui.label("Columns of the file").classes("part")
        for role in ROLES[kind]:
            with ui.row().classes("w-full no-wrap"):
                column = choice(
                    ["", *titles], likely[role], role, f"column-{role}", new_value_mode="add-unique"
                )
                self._columns[role] = column.classes("w-40")
                self._units[role] = field(f"its unit, if not {UNITS[role]}", "", "as written", f"unit-{role}")
        sections = sizes_of(kind, self._start())
        if sections:
            ui.label("Sizes, with their units").classes("part")
        with ui.row().classes("w-full"):
            for section, sizes in sections.items():
                prefix = "blade " if section == "blade" else ""
                self._sizes[section] = {
                    name: field(prefix + name, text, "", f"{section}-{name}") for name, text in sizes.items()
                }

    def _take(self, given: list[tuple[str, bytes]]) -> None:
        try:
            for name, content in given:
                self._heads[name] = keep_file(self._folder, name, content)
        finally:
            self._show_files()

    def _forget(self) -> None:
        self._heads.clear()
        self._show_files()

    def _show_files(self) -> None:
        self._names.set_text(", ".join(self._heads))
        self._over.set_visibility(bool(self._heads))
        self._head.set_text("\n".join(next(iter(self._heads.values()), [])))
        self._head.set_visibility(bool(self._heads))
        self._about.set_visibility(self._campaign() is None)
        self._fields.refresh()

    def _start(self) -> Case:
        return Choice(str(self._like.value), str(self._tool.value)).start()

    def _campaign(self) -> str | None:
        """The campaign file among the files, which says all that the form asks."""
        return next((name for name in self._heads if name.endswith(".toml")), None)

    def _request(self) -> dict[str, object]:
        def filled(fields: Mapping[str, ui.input | ui.select]) -> dict[str, str]:
            return {name: text for name, box in fields.items() if (text := str(box.value or "").strip())}

        asked = {
            "files": [*self._heads], "kind": self._kind.value, "material": self._like.value,
            "columns": filled(self._columns), "units": filled(self._units), "speed": self._speed.value,
            **dict(zip(TAKEN_OFF, (self._zero.value, self._rest.value), strict=True)),
        }  # fmt: skip
        return asked | {part: filled(sizes) for part, sizes in self._sizes.items()}

    def _draw(self) -> tuple[Path, Campaign] | None:
        """The campaign and its file, drawn; None where it is refused, which is said."""
        with refusals(self._alert):
            own = self._campaign()
            file = self._folder / own if own else write_campaign(self._folder, self._request(), self._start())
            campaign = load_campaign(file)
            picture = base64.b64encode(svg_of(campaign.plot).encode()).decode()
            self._picture.set_source(f"data:image/svg+xml;base64,{picture}")
            self._picture.set_visibility(True)
            return file, campaign
        return None

    def _begin(self, kind: str) -> None:
        if (drawn := self._draw()) is None:
            return
        with refusals(self._alert):
            file, campaign = drawn
            self._bench.jobs.check_free()
            folder = self._bench.place(kind)
            folder.mkdir()
            (folder / "campaign.toml").write_bytes(file.read_bytes())
            self._watch.watch(self._bench.jobs.start(kind, campaign.title, folder, _TASKS[kind], file))

    def _job_changed(self, job: Job) -> None:
        self._stages.clear()
        with self._stages:
            for stage in job.stages:
                with ui.element("li"):
                    ui.label(stage)
        if (picture := job.folder / "fit.png").is_file():
            self._picture.set_source(self._bench.address(picture))
            self._picture.set_visibility(True)
        page = job.folder / "discovery.html"
        self._frame.set_visibility(page.is_file())
        if page.is_file():
            self._frame.props(f'src="{self._bench.address(page)}"')
