"""The rendering job: renders the models of a catalogue to a data set, in several processes.

A process of a `pool.Pool` renders the samples of a model, which are written to a file. When all
models of a block are rendered, the block becomes a shard. When all blocks are complete, the data
set is complete (`job_folder`). For a given model file, the samples depend only on the settings and
the model's name. The data set is therefore identical, byte for byte, for any number of workers,
restarts and parts. It is also the same if it is rendered on a cluster, or extended instead of
rendered at once.
"""

import dataclasses
import json
import os
import pathlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

from absl import logging

from data_gen import job_folder, pool, settings
from data_gen.backgrounds import list_pictures
from data_gen.blocks import Job, Name
from data_gen.catalogues import choosing
from data_gen.catalogues.choosing import Choice
from data_gen.catalogues.entry import Catalogue, Entry
from data_gen.environment_maps import load_maps
from data_gen.job_folder import OtherSettingsError
from data_gen.mitsuba_setup import choose_variant
from data_gen.render_model import Context
from data_gen.results import read_result, work_path, write_result
from data_gen.settings import Settings
from psgn_jax.claims import claim
from psgn_jax.untrusted import one_line

__all__ = ["REPORT", "OtherSettingsError", "Summary", "job_of", "render_catalogue"]

REPORT = job_folder.REPORT

# Increased when the same settings give other samples or the layout of the folder changes.
_FORMAT = 2

EVERYTHING = Choice()


@dataclasses.dataclass(frozen=True)
class Summary:
    """The result of a job.

    Attributes:
      models: number of models of the catalogue.
      statuses: number of models with each status.
      samples: number of samples in the data set.
      complete: whether all parts are done.
      lines: lines of the models, in the order of the catalogue.
      seconds: duration of this call.
      rendered: number of images that this call rendered.
    """

    models: int
    statuses: Mapping[str, int]
    samples: int
    complete: bool
    lines: tuple[Mapping[str, Any], ...]
    seconds: float
    rendered: int

    @property
    def exit_code(self) -> int:
        """Exit code of the command.

        0 all models have samples; 1 some were refused; 2 all were refused; 3 other parts are not
        finished.
        """
        if not self.complete:
            return 3
        if not self.samples:
            return 2
        return 0 if self.statuses.get("ok", 0) == self.models else 1

    def text(self) -> str:
        """The summary as text."""
        passed = self.statuses.get("ok", 0)
        out = [
            f"{self.models} models: "
            + ", ".join(f"{n} {status}" for status, n in sorted(self.statuses.items())),
            f"{self.samples} samples"
            + ("" if self.complete else "; other parts of the job are not finished"),
        ]
        if self.rendered:
            rate = self.rendered / max(self.seconds, 1e-9)
            out.append(f"{self.rendered} images in {self.seconds:.0f} s: {rate:.2f} images/s")
        views = [v for line in self.lines if line["status"] == "ok" for v in line["views"]]
        if views:
            mean = sum(v["inside"] for v in views) / len(views)
            out.append(
                f"points inside the dilated mask: {100 * mean:.3f} %; median distance of depth "
                f"from points: at most {max(v['depth'] for v in views):.4f}; brightness: "
                f"{min(v['luminance'] for v in views):.1f} to "
                f"{max(v['luminance'] for v in views):.1f}; peak memory of a worker: "
                f"{max(line.get('megabytes', 0) for line in self.lines)} MB"
            )
        for line in self.lines:
            if line["status"] != "ok" and len(out) < 40:
                out.append(f"  {line['status']}: {line['model_id']}: {line['reason']}")
        if self.models - passed > len([o for o in out if o.startswith("  ")]):
            out.append(f"  and more: see {REPORT}")
        return "\n".join(map(one_line, out))


def job_of(
    name: str, entries: Sequence[Entry], options: Settings, variant: str, choice: Choice, limit: int
) -> Job:
    """Everything that determines the bytes of the data set, except the contents of model files."""
    values = settings.to_dict(options)
    del values["job"]
    return Job(
        statement={
            "format": _FORMAT,
            "source": name,
            "settings": json.loads(json.dumps(values)),
            "variant": variant,
        },
        choice=json.loads(json.dumps({**dataclasses.asdict(choice), "limit": limit})),
        names=tuple(Name(e.model_id, e.category, e.split) for e in entries),
        models_per_shard=options.models_per_shard,
    )


def _summary(
    entries: list[Entry],
    lines: list[Mapping[str, Any]],
    complete: bool,
    started: float,
    rendered: int,
) -> Summary:
    statuses: dict[str, int] = {}
    for line in lines:
        statuses[line["status"]] = statuses.get(line["status"], 0) + 1
    if len(lines) < len(entries):
        statuses["open"] = len(entries) - len(lines)
    return Summary(
        models=len(entries),
        statuses=statuses,
        samples=sum(line["samples"] for line in lines),
        complete=complete,
        lines=tuple(lines),
        seconds=time.monotonic() - started,
        rendered=rendered,
    )


def render_catalogue(
    catalogue: Catalogue,
    out: str | os.PathLike[str],
    options: Settings,
    *,
    part: tuple[int, int] = (0, 1),
    choice: Choice = EVERYTHING,
    limit: int = 0,
    render: pool.Pool = pool.render_local,
) -> Summary:
    """Renders a catalogue to a data set; continues an incomplete one or extends a complete one.

    If the folder contains a complete data set and all its models are among those of this call, the
    other models of this call are added. Readers see the old state until the new one is complete.

    Args:
      catalogue: source of the models.
      out: folder of the data set, created if missing.
      options: all settings.
      part: (i, n): the i-th of n parts of the work, i from 0.
      choice: which models of the catalogue are used.
      limit: use only the first `limit` of the chosen models; 0 = all.
      render: function that renders the models: `pool.render_local`, or `cluster.render_on` with an
        address.

    Raises:
      ValueError: `out` contains something else, or models that are not in this call; another
        process renders the same part; or a setting is wrong.
      RuntimeError: Mitsuba is missing or does not run, on this machine or on the workers.
    """
    started = time.monotonic()
    out = pathlib.Path(out)
    entries = choosing.choose(list(catalogue.entries()), choice)[: limit or None]
    if not entries:
        raise ValueError(f"catalogue {catalogue.name!r}: it has no models")
    variant, message = choose_variant(options.job.variant)
    if message:
        logging.warning("%s", message)
    job = job_of(catalogue.name, entries, options, variant.name, choice, limit)
    if job_folder.check(out, job):
        job_folder.tidy_up(out, job)
        logging.info("%s is complete", out)
        return _summary(entries, job_folder.read_report(out), True, started, 0)
    # Read before anything is written, so that an error here leaves the folder unchanged.
    pictures = (
        list_pictures(options.image.background_folder)
        if options.image.background == "folder"
        else []
    )
    maps = load_maps(options.light, variant, detail=options.image.shading == "photo")
    context = Context(options, catalogue.name, variant, maps, pictures)
    with claim(out / job_folder.WORK, part):
        if job_folder.begin(out, job):  # another process has completed it meanwhile
            return _summary(entries, job_folder.read_report(out), True, started, 0)
        rendered = _render_part(out, job, entries, context, part, render, started)
        lines, complete = job_folder.complete(out, job, job.blocks())
    return _summary(entries, lines, complete, started, rendered)


def _render_part(
    out: pathlib.Path,
    job: Job,
    entries: Sequence[Entry],
    context: Context,
    part: tuple[int, int],
    render: pool.Pool,
    started: float,
) -> int:
    """Renders the missing models of a part of the work; returns the number of images."""
    folder = out / job_folder.WORK
    blocks = job.blocks()
    own = blocks[part[0] :: part[1]]
    job_folder.take_over(out, own, job)
    open_blocks = {b: set(b.indices) for b in own if job_folder.read_block(out, b) is None}
    block_of = {i: b for b in open_blocks for i in b.indices}
    for left in folder.glob("*.tmp"):
        if part == (0, 1):
            left.unlink(missing_ok=True)  # left by a process that was killed

    def mark_rendered(index: int) -> None:
        block = block_of[index]
        open_blocks[block].discard(index)
        if not open_blocks[block]:
            job_folder.finish_block(out, block)

    todo = []
    for block in open_blocks:
        for index in block.indices:
            try:
                read_result(work_path(folder, entries[index].model_id))
            except ValueError:
                todo.append(index)
    fresh = set(todo)
    for index in [i for i in block_of if i not in fresh]:
        mark_rendered(index)
    logging.info(
        "%d of %d models to render, %d views each, %s", len(todo), len(entries),
        context.settings.views, context.variant.name,
    )  # fmt: skip
    rendered = refused = 0
    reported = time.monotonic()
    results = render([(i, entries[i]) for i in todo], context) if todo else ()
    for done, (index, line, content) in enumerate(results, 1):
        write_result(folder, entries[index].model_id, content)
        mark_rendered(index)
        rendered += line["samples"]
        if line["status"] != "ok":
            refused += 1
            what = one_line(f"{line['status']}: {line['model_id']}: {line['reason']}")
            logging.warning("%s", what)
        now = time.monotonic()
        if now - reported > 10 or done == len(todo):
            reported = now
            seconds = (now - started) / done * (len(todo) - done)
            logging.info(
                "%d of %d models, %d images, %.2f images/s, %d refused, %d:%02d:%02d left",
                done, len(todo), rendered, rendered / (now - started), refused,
                seconds // 3600, seconds % 3600 // 60, seconds % 60,
            )  # fmt: skip
    return rendered
