"""One module for each subcommand of `psgn`."""

import os

# Hides a wrong warning of XLA, see `common.keep_compiled`. It has no effect once jaxlib has been
# imported, so it is here, where it precedes the imports of every command.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
