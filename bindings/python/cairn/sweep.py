"""Runs a sweep of the study on a cluster, with Ray: `python -m cairn.sweep FILE.toml`.

The study lists the jobs and decides which are complete. This module passes the jobs to Ray, whose workers run `study sweep FILE --only JOB`,
and at the end the study writes the report. The study also writes the manifests that tell which jobs are complete, so a sweep
that was begun on one machine can be continued on a cluster, and the other way round.

Only `run` needs Ray, and imports it: `pip install "cairn[cluster]"`.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

LIST_VERSION = 1
"""The version of the list of jobs that this module reads."""

EXAMPLES = """\
examples:
  python -m cairn.sweep tools/study/sweeps/smoke.toml --study target/release/study
      on this machine, with a Ray of its own

  python -m cairn.sweep /shared/mine.toml --out /shared/sweep --study /shared/study --address auto
      on the cluster that this machine belongs to

Every machine must see the study, the sweep's file and the folder --out under the same names, as on a shared disk; --out must take
file locks. Each needs this package, ONNX Runtime, and the weights of LPIPS where a sweep measures it: what the study fetches by itself, or what
CAIRN_ONNXRUNTIME and CAIRN_LPIPS name there.

After an interruption, run the same command again: complete jobs are not repeated.
"""


class SweepError(RuntimeError):
    """The study refused or failed; the text is the study's."""


class Killed(SweepError):
    """The study was killed before its job was complete; the job is run again."""


@dataclass(frozen=True)
class Job:
    """One rollout and its measurements."""

    name: str
    """Identifies it among all jobs."""
    scene: str
    place: int
    operating_point: str
    frames: int
    whole: bool
    """Whether it was complete when the jobs were listed."""


@dataclass(frozen=True)
class Study:
    """The study's program, a sweep's file and the output folder."""

    program: Path
    plan: Path
    out: Path

    def command(self, *more: str) -> list[str]:
        """The command line."""
        return [str(self.program), "sweep", str(self.plan), "--out", str(self.out), "--quiet", *more]

    def call(self, *more: str) -> str:
        """Runs the program and returns its output.

        Raises `Killed` if a signal ended it, `SweepError` with its own message if it failed.
        """
        ended = subprocess.run(self.command(*more), stdin=subprocess.DEVNULL, capture_output=True, check=False)
        if ended.returncode == 0:
            return ended.stdout.decode("utf-8", "replace")
        said = ended.stderr.decode("utf-8", "replace").strip()
        # After a signal subprocess gives its negative number; a shell in between gives 128 and the number.
        signal = -ended.returncode if ended.returncode < 0 else ended.returncode - 128
        if 1 <= signal <= 64:
            raise Killed(f"signal {signal} ended the study: {said}".rstrip(": "))
        raise SweepError(said or f"the study ended with status {ended.returncode}")

    def jobs(self) -> tuple[list[Job], int]:
        """All jobs, and the number of threads of each."""
        listed = json.loads(self.call("--list-jobs"))
        version = listed.get("list_version")
        if version != LIST_VERSION:
            raise SweepError(f"the study's list of jobs has version {version}, this reads {LIST_VERSION}. Use a study and a package of one version")
        return [Job(**job) for job in listed["jobs"]], int(listed["threads"])

    def make(self, name: str) -> None:
        """Runs one job, if it is not complete."""
        self.call("--only", name)

    def report(self) -> str:
        """Runs jobs that are not complete, writes the report on all jobs, and returns it as Markdown."""
        return self.call("--jobs", "1")


def find_study(program: str | os.PathLike[str] | None = None) -> Path:
    """The path of the program: the given one, else the one in `CAIRN_STUDY`, else the one on the path."""
    named = program or os.environ.get("CAIRN_STUDY")
    found = shutil.which(named or "study")
    if found is None:
        raise SweepError(f"{named or 'study'} is no program that runs. Build it (cargo build --release -p study) and name it with --study")
    return Path(found).absolute()


def run(
    plan: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    study: str | os.PathLike[str] | None = None,
    address: str | None = None,
    retries: int = 3,
    on_complete: Callable[[int, int, str], None] | None = None,
) -> str:
    """Runs the incomplete jobs of a sweep on a Ray cluster, and writes its report, which is returned as Markdown.

    `address` is Ray's: `"auto"` for the cluster that this machine belongs to, none for a new one on this machine; if Ray is initialised
    already, that one is used. Every job takes as many of Ray's processors as it has threads. A job whose worker or study is killed is run
    again, up to `retries` times. After any other failure the remaining jobs are cancelled, and complete ones are kept. `on_complete` is called
    for every complete job with the number of complete jobs, their total, and the job's name.

    Raises `SweepError`.
    """
    try:
        import ray
    except ImportError as missing:
        raise SweepError('Ray is not installed: pip install "cairn[cluster]"') from missing

    own = Study(find_study(study), Path(plan).absolute(), Path(out).absolute())
    jobs, threads = own.jobs()
    missing_jobs = [job for job in jobs if not job.whole]
    done = len(jobs) - len(missing_jobs)
    if missing_jobs:
        begun_here = not ray.is_initialized()
        if begun_here:
            ray.init(address=address, log_to_driver=False, include_dashboard=False if address is None else None)
        try:
            for name in _through_ray(ray, own, missing_jobs, threads, retries):
                done += 1
                if on_complete is not None:
                    on_complete(done, len(jobs), name)
        finally:
            if begun_here:
                ray.shutdown()
    return own.report()


def _make(study: Study, name: str) -> str:
    """The function that a worker of Ray runs."""
    study.make(name)
    return name


def _through_ray(ray, study: Study, jobs: Sequence[Job], threads: int, retries: int):
    """Runs all jobs with Ray; yields their names as they complete."""
    task = ray.remote(num_cpus=threads, max_retries=retries, retry_exceptions=[Killed])(_make)
    pending = {task.remote(study, job.name): job for job in jobs}
    try:
        while pending:
            (ended, *_), _ = ray.wait(list(pending), num_returns=1)
            job = pending.pop(ended)
            try:
                name = ray.get(ended)
            except ray.exceptions.RayError as error:
                # A worker's exception has our error as its cause; an error of Ray itself has none.
                raise SweepError(f"{job.name}: {getattr(error, 'cause', None) or error}") from error
            yield name
    finally:
        for left in pending:
            ray.cancel(left)


def parser() -> argparse.ArgumentParser:
    """The parser of all options."""
    made = argparse.ArgumentParser(
        prog="python -m cairn.sweep",
        description="Makes a sweep of the study on a cluster, through Ray. docs/sweep.md tells what a sweep is.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("plan", metavar="FILE", help="the sweep, in TOML")
    made.add_argument("--out", metavar="DIR", default="target/sweep", help="folder for everything (default: %(default)s)")
    made.add_argument("--study", metavar="PROGRAM", help="the study; else CAIRN_STUDY names it, or it is on the path")
    made.add_argument("--address", metavar="ADDRESS", help="of a Ray cluster, such as auto; without it one is started on this machine")
    made.add_argument("--retries", metavar="N", type=int, default=3, help="how often a killed job is made again (default: %(default)s)")
    made.add_argument("--quiet", action="store_true", help="no progress")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line and returns its exit status."""
    given = parser().parse_args(arguments)

    def print_progress(done: int, of: int, name: str) -> None:
        print(f"{done} of {of}: {name}", file=sys.stderr, flush=True)

    try:
        text = run(
            given.plan,
            given.out,
            study=given.study,
            address=given.address,
            retries=given.retries,
            on_complete=None if given.quiet else print_progress,
        )
    except SweepError as error:
        print(str(error) if str(error).startswith("error: ") else f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted: finished parts are kept, and the same command continues", file=sys.stderr)
        return 130
    print(text, end="")
    return 0


if __name__ == "__main__":
    # The name under which Ray's workers import it, so that both use the same classes.
    from cairn.sweep import main as named

    sys.exit(named())
