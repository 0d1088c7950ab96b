"""`python -m wsp_env` is `wsp`."""

import sys

from wsp_env.cli import main

sys.exit(main())
