"""``python -m tradestudy``."""

import sys

try:
    from tradestudy.cli import main

    main()
except KeyboardInterrupt:  # while Python is still loading the program
    sys.exit(130)
