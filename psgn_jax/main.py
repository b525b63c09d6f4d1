"""`python -m psgn_jax.main` is `psgn train`."""

import sys

from psgn_jax.commands.train import main
from psgn_jax.system.terminal import start_command

if __name__ == "__main__":
    start_command()
    sys.exit(main())
