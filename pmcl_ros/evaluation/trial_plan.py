"""Plans trials: captures x rows x seeds, and searches for objects that are not there."""

from dataclasses import dataclass

from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.evaluation.trials import Job
from pmcl_ros.evaluation.variants import Variant


@dataclass(frozen=True)
class TrialPlan:
    """Trials to be made.

    others: captures whose objects are looked for too, where they are not: in each capture, and
    with each seed, another one. Empty: none.
    """

    captures: tuple[Capture, ...]
    variants: tuple[Variant, ...]
    seeds: tuple[int, ...]
    others: tuple[Capture, ...] = ()

    def jobs(self) -> list[Job]:
        """All trials; those of one volume follow each other."""
        return [job for number, capture in enumerate(self.captures)
                for job in self._jobs_in(capture, number)]

    def _jobs_in(self, capture: Capture, number: int) -> list[Job]:
        there = {each.object for each in self.others if capture.shows(each)}
        others = [] if capture.truth.empty else list({
            each.object: each for each in self.others
            if each.object not in there | {capture.object}}.values())
        jobs = []
        for variant in self.variants:
            jobs += [Job(capture, capture, variant, seed) for seed in self.seeds]
            jobs += [Job(capture, others[(number + k) % len(others)], variant, seed)
                     for k, seed in enumerate(self.seeds) if others]
        # The volume depends on the row's base and changes and, by its size, on the object.
        volumes = {each: number for number, each in enumerate(dict.fromkeys(map(_volume, jobs)))}
        return sorted(jobs, key=lambda job: volumes[_volume(job)])


def _volume(job: Job) -> tuple[object, ...]:
    return job.variant.base, job.variant.dlv, job.sought.model
