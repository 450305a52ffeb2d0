"""``python -m tradestudy``."""

import sys

try:
    from tradestudy.cli import main

    main()
except KeyboardInterrupt:  # while Python still loads the program
    sys.exit(130)
