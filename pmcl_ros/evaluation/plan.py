"""Which trials are made: captures x rows x seeds, and searches for objects that are not there."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.evaluation.pool import Batch
from pmcl_ros.evaluation.shared import Shared
from pmcl_ros.evaluation.trials import Job
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.light_field import ViewGrid
from pmcl_ros.pmcl.object_model import ObjectModel


@dataclass(frozen=True)
class Wanted:
    """One trial in a capture: its row, the capture whose object is sought, the seed."""

    variant: Variant
    sought: Capture
    seed: int


@dataclass(frozen=True)
class Plan:
    """Trials to be made.

    others: captures whose objects are looked for too, where they are not: with each seed another
    one. Empty: none. decoders: of the camera; None where all captures are light fields.
    """

    captures: tuple[Capture, ...]
    variants: tuple[Variant, ...]
    seeds: tuple[int, ...]
    others: tuple[Capture, ...] = ()
    decoders: Decoders | None = None

    @property
    def count(self) -> int:
        """How many trials these are."""
        return sum(len(self._wanted(each)) for each in self.captures)

    def batches(self, folder: Path) -> Iterator[Batch]:
        """The trials by volume, made when asked for and written into a folder."""
        number, source = 0, None
        for capture in self.captures:
            if capture.source != source:
                started = time.perf_counter()
                light_field = capture.light_field(self.decoders)
                decoded = time.perf_counter() - started
                source = capture.source
            for settings, group in self._groups(capture, light_field.grid):
                started = time.perf_counter()
                volume = Shared.put(group[0].variant.build(light_field, settings),
                                    folder / f'{number}.volume')
                built = time.perf_counter() - started
                yield Batch(volume, tuple(Job(capture, each.sought, each.variant, each.seed,
                                              volume, built, decoded) for each in group))
                number += 1

    def _wanted(self, capture: Capture) -> list[Wanted]:
        others = {} if capture.truth.empty else {
            each.object: each for each in self.others
            if each.object != capture.object and each.source != capture.source}
        result = []
        for variant in self.variants:
            result += [Wanted(variant, capture, seed) for seed in self.seeds]
            result += [Wanted(variant, list(others.values())[k % len(others)], seed)
                       for k, seed in enumerate(self.seeds) if others]
        return result

    def _groups(self, capture: Capture, grid: ViewGrid
                ) -> list[tuple[DlvSettings, list[Wanted]]]:
        """What can be done with one volume, and that volume's settings."""
        groups: dict[tuple[bool, DlvSettings], list[Wanted]] = {}
        models: dict[Path, ObjectModel] = {}
        for each in self._wanted(capture):
            path = each.sought.model
            if path not in models:
                models[path] = ObjectModel.load(path)
            settings = each.variant.volume(capture, models[path], grid)
            groups.setdefault((each.variant.base == 'centre', settings), []).append(each)
        return [(settings, group) for (_, settings), group in groups.items()]
