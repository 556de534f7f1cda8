"""`python -m veriray` is the command `veriray`."""

import sys

from .cli import main

sys.exit(main())
