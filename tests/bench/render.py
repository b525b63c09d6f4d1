"""Images per second of the data stage on one core, and a worker's peak memory.

    python tests/bench/render.py [--catalogue procedural] [--source 4] [--models 30]

Renders models spread over a catalogue in this process, with one thread. All steps are included:
reading the mesh, points, pictures, checks, occupancy, encoding. Prints images per second of
wall-clock time and of CPU time (the figure per core on a busy machine), and the peak memory of the
process.
"""

import argparse
import os
import resource
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

from data_gen import engine, settings  # noqa: E402
from data_gen.catalogues.open_catalogue import open_catalogue  # noqa: E402
from data_gen.render_model import Context, render_model  # noqa: E402


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--catalogue", default="procedural")
    parser.add_argument("--source", default="4")
    parser.add_argument("--models", type=int, default=30)
    arguments = parser.parse_args()
    variant, message = engine.choose_variant("auto")
    print(variant.name, message)
    os.environ["DRJIT_LIBLLVM_PATH"] = variant.libllvm
    engine.start(variant.name)
    entries = list(open_catalogue(arguments.catalogue, arguments.source).models)
    chosen = entries[:: max(1, len(entries) // arguments.models)][: arguments.models]
    context = Context(settings.Settings(views=4), arguments.catalogue, variant, None)
    render_model(chosen[0], context)  # not timed: the first model also compiles and loads modules
    wall, cpu = time.perf_counter(), time.process_time()
    images = sum(len(render_model(entry, context)[0]) for entry in chosen)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    print(f"{images} images of {len(chosen)} models")
    print(f"{images / wall:.2f} images/s of wall-clock time, {images / cpu:.2f} of CPU time")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
