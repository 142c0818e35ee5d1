"""The files of the maps of a total: a picture per quantity and step, a sheet per phase, an animation."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from functools import cache, partial

from dicflow.kinds.maps import Maps
from dicflow.pipeline.result import Result
from dicflow.views.levels import Levels, field_levels, gif_file, opened, png_file
from dicflow.views.map_pictures import contact_sheet, map_cells, map_sheet, map_tile
from dicflow.views.published import Job, Published, source_of
from dicflow.views.windows import map_look, map_window

__all__ = ["MapFiles"]


class MapFiles:
    """The files of one stage of maps.

    folder : of the stage, below the one of the result
    code : digest of the code that draws
    """

    def __init__(self, result: Result, stage: str, variant: int, folder: str, code: str) -> None:
        maps = Maps.read(result.product(stage, None, variant))
        total = result.source(stage, "total", variant)
        self._total = partial(result.product, total, variant=variant)
        self._folder, self._code, self._window = folder, code, map_window(maps)
        self._looks = {quantity: map_look(maps, quantity) for quantity in maps.quantities}
        steps = result.steps(total, variant)
        self._phases, self._steps = [maps.phases[n] for n in maps.drawn], [steps[n] for n in maps.drawn]
        self._titles = [f"{step} · {phase}" for step, phase in zip(self._steps, self._phases, strict=True)]
        self._arrays = [result.arrays(total, step, variant) for step in self._steps]
        self._sheet = cache(lambda quantity: map_sheet(self._looks[quantity], self._window, self._titles))

    def pictures(self) -> Iterator[Job]:
        """One job per step: its picture of each quantity."""
        for number in range(len(self._steps)):
            sources = {self._picture(quantity, number): self._source(quantity, number) for quantity in self._looks}
            yield Job(sources, partial(self._draw_step, number))

    def overviews(self, published: Published) -> Iterator[Job]:
        """One job per quantity: its sheets and its animation, from the pictures of the steps."""
        for quantity in self._looks:
            made_of = [self._source(quantity, number) for number in range(len(self._steps))]
            sources = {
                self._overview(quantity, phase): source_of(phase, *(made_of[number] for number in self._of(phase)))
                for phase in dict.fromkeys(self._phases)
            }
            sources[f"{self._folder}{quantity}.gif"] = source_of("animation", *made_of)
            yield Job(sources, partial(self._draw_overviews, published, quantity))

    def _picture(self, quantity: str, number: int) -> str:
        return f"{self._folder}{quantity}/{self._steps[number]}.png"

    def _overview(self, quantity: str, phase: str) -> str:
        return f"{self._folder}{quantity}_{phase}.png"

    def _of(self, phase: str) -> list[int]:
        """Numbers of the steps of a phase."""
        return [number for number, other in enumerate(self._phases) if other == phase]

    def _source(self, quantity: str, number: int) -> str:
        """Digest of all that a picture shows, and of the size that it has by its longest title."""
        arrays = self._arrays[number]
        shown = [arrays[self._window.positions].digest, arrays[quantity].digest, self._titles[number]]
        return source_of(self._code, self._looks[quantity], self._window, self._sheet(quantity).size, shown)

    def _draw_step(self, number: int, files: Collection[str]) -> Mapping[str, bytes]:
        chosen = [quantity for quantity in self._looks if self._picture(quantity, number) in files]
        drawn = self._drawn(number, chosen)
        return {
            self._picture(quantity, number): png_file(picture, self._sheet(quantity).colours)
            for quantity, picture in drawn.items()
        }

    def _drawn(self, number: int, quantities: Collection[str]) -> dict[str, Levels]:
        """The pictures of some quantities at a step."""
        total = self._total(self._steps[number])
        cells = map_cells(total, self._window, map_tile(self._window))
        return {
            quantity: self._sheet(quantity).filled(
                [field_levels(total[quantity], cells, self._looks[quantity])], [self._titles[number]]
            )
            for quantity in quantities
        }

    def _draw_overviews(self, published: Published, quantity: str, files: Collection[str]) -> Mapping[str, bytes]:
        look, sheet = self._looks[quantity], self._sheet(quantity)
        shown = cache(partial(self._shown, published, quantity))
        drawn = {}
        for phase in dict.fromkeys(self._phases):
            if (file := self._overview(quantity, phase)) in files:
                chosen = self._of(phase)
                maps, names = [sheet.map_in(shown(number)) for number in chosen], [self._steps[n] for n in chosen]
                drawn[file] = contact_sheet(maps, names, look, self._window, f"{look.title}, {phase}")
        if (file := f"{self._folder}{quantity}.gif") in files:
            drawn[file] = gif_file((shown(number) for number in range(len(self._steps))), sheet.colours)
        return drawn

    def _shown(self, published: Published, quantity: str, number: int) -> Levels:
        """The picture of a step as it is published, else drawn again."""
        found = published.content(self._picture(quantity, number))
        return opened(found) if found is not None else self._drawn(number, [quantity])[quantity]
