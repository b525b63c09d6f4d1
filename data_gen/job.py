"""The rendering job: a data set of the models of a catalogue, from several processes.

The samples of a model depend only on its file and name and on the settings. So the data set is the
same, byte for byte, for any number of workers, restarts and parts, on a cluster, too.
`psgn_jax.data.shards` describes the folder of a job.
"""

import contextlib
import dataclasses
import functools
import os
import pathlib
from collections import Counter
from collections.abc import Generator, Sequence

from absl import logging

from data_gen import lights, pool
from data_gen.catalogues import choosing
from data_gen.catalogues.choosing import Choice
from data_gen.catalogues.entry import SPLITS, Catalogue, moved_to_empty_splits, original_name
from data_gen.engine import choose_variant
from data_gen.environment_maps import fingerprint, load_maps
from data_gen.mesh import kind_of_warning
from data_gen.render_model import Context, checksum
from data_gen.settings import Settings
from psgn_jax.config import structured
from psgn_jax.data import shards
from psgn_jax.data.shards import REPORT
from psgn_jax.system.untrusted import one_line

_FORMAT = 2  # raise it if the same settings give other samples

_RETRIED = ("crashed", "error", "memory", "timeout", "unreadable")
"""Statuses that may depend on the machine or the limits. If a data set is complete, a call for the
whole set tries models with these statuses again."""

_FEW = 20  # a warning names smaller sets
_SHOWN = 40  # largest number of logged warnings of a kind, and of refusals in a summary


def _warn_of_few(lines: Sequence[shards.Line], wanted: Sequence[str]) -> None:
    made = {original_name(x["model_id"]): x["split"] for x in lines if x["samples"]}
    counts = Counter(made.values())
    if counts.total() < _FEW:
        logging.warning(
            "a small set (models with samples: %s): a network overfits on it, and its figures say "
            "little; the catalogue's option fractions=0.6,0.2,0.2 sets the fractions of the splits",
            ", ".join(f"{counts[split]} in {split!r}" for split in wanted),
        )
    if empty := [split for split in wanted if not counts[split]]:
        logging.warning("no samples in %s: mend refused files or add models", ", ".join(empty))


def _logged(results: Generator[shards.Result]) -> Generator[shards.Result]:
    """The results. It logs warnings of their models, up to `_SHOWN` of each kind."""
    kinds: Counter[str] = Counter()
    with contextlib.closing(results):
        for result in results:
            for what in result.line.get("warnings", ()):
                kinds[kind := kind_of_warning(what)] += 1
                if kinds[kind] <= _SHOWN:
                    more = "; other models only in the count at the end"
                    text = f"warning: {result.line['model_id']}: {what}"
                    logging.warning("%s", one_line(text + more * (kinds[kind] == _SHOWN)))
            yield result


def text_of(progress: shards.Progress) -> str:
    """A summary of a call: numbers of models, reasons of refusals, numbers of warnings."""
    counts = ", ".join(f"{n} {status}" for status, n in sorted(progress.statuses.items()))
    later = "" if progress.complete else "; other parts of the job are not finished"
    out = [f"{progress.inputs} models: {counts}", f"{progress.samples} samples{later}"]
    refused = [line for line in progress.lines if line["status"] != "ok"]
    out += [f"  {x['status']}: {x['model_id']}: {x['reason']}" for x in refused[:_SHOWN]]
    if len(refused) > _SHOWN:
        out.append(f"  and more: see {REPORT}")
    if again := sorted({x["status"] for x in refused}.intersection(_RETRIED)):
        limits = "limits: job.seconds_per_model, job.megabytes_per_worker"
        out.append(f"run the command again to retry what is {', '.join(again)} ({limits})")
    if any("file_crc32" in line for line in refused):
        out.append("mend refused files and run the command again")
    kinds = Counter(kind_of_warning(w) for x in progress.lines for w in x.get("warnings", ()))
    out += [f"  warning in {n} model{'s' * (n > 1)}: {kind}" for kind, n in kinds.most_common()]
    return "\n".join(map(one_line, out))


def render_catalogue(
    catalogue: Catalogue,
    out: str | os.PathLike[str],
    options: Settings,
    *,
    part: tuple[int, int] = (0, 1),
    choice: Choice | None = None,
    render: pool.Pool = pool.render_local,
) -> shards.Progress:
    """Renders a catalogue to a data set, or continues a data set.

    If it tries models of a complete data set again, readers see the old state until the new state
    is complete. If `split_of` leaves a split of the catalogue empty, we move a model to it.

    Args:
      catalogue: the models.
      out: folder of the data set; created if missing.
      options: all settings.
      part: (i, n): the i-th of n parts of the work, i from 0.
      choice: chooses models of the catalogue; None = all.
      render: `pool.render_local`, or `cluster.render_on` with an address.

    Raises:
      ValueError: `out` contains something else, or other models; another process renders the same
        part; or a setting is wrong.
      RuntimeError: Mitsuba is missing or does not run, on this machine or on the workers.
    """
    out = pathlib.Path(out)
    choice = choice or Choice()
    entries = choosing.choose(catalogue.models, choice)
    if not entries:
        raise ValueError(f"catalogue {catalogue.name!r}: it has no models")
    variant, message = choose_variant(options.job.variant)
    if message:
        logging.warning("%s", message)
    wanted = [s for s, share in zip(SPLITS, catalogue.fractions or (), strict=False) if share]
    splits = {original_name(e.model_id): e.split for e in entries}
    splits |= moved_to_empty_splits(splits, wanted)
    entries = [dataclasses.replace(e, split=splits[original_name(e.model_id)]) for e in entries]
    values = structured.to_dict(options)
    del values["job"]
    if options.light.folder:
        values["light"]["folder"] = f"maps {fingerprint(options.light.folder)}"
    # What determines the bytes of the data set, except the content of model files.
    statement = {
        "format": _FORMAT, "source": catalogue.name, "settings": values, "variant": variant.name,
    }  # fmt: skip
    about = {"choice": dataclasses.asdict(choice)}
    inputs = [(shards.Tag(e.model_id, e.category, e.split), e) for e in entries]
    finders = {e.model_id: e.find_file for e in entries}
    checksum_now = functools.cache(checksum)

    def tries_again(line: shards.Line) -> bool:
        if part != (0, 1):  # parts of a job array do not wait for each other
            return False
        if line["status"] != "refused" or "file_crc32" not in line:
            return line["status"] in _RETRIED
        return checksum_now(finders[line["model_id"]]) not in (None, line["file_crc32"])

    job = shards.Job(statement, inputs, options.models_per_shard, about, tries_again=tries_again)
    maps = None
    if options.light.folder and not shards.is_complete(out, job):
        # Before anything is written, so that an error leaves the folder unchanged.
        detail = options.image.shading == "photo" or options.light.source == "mixed"
        size = lights.DETAIL if detail else lights.MAP_SIZE
        maps = load_maps(options.light.folder, variant, size)
    context = Context(options, catalogue.name, variant, maps)
    progress = shards.write(out, job, lambda tasks: _logged(render(tasks, context)), part)
    if wanted and progress.complete:
        _warn_of_few(progress.lines, wanted)
    return progress
