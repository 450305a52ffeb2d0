"""``python -m tradestudy``."""

import sys

try:
    from tradestudy.cli import main

    main()
except KeyboardInterrupt:  # while Python is still loading the program
    sys.exit(130)
finally:
    # A Ctrl-C that passed through exec (of dataclasses, say) would make Python end by the signal instead of with 130,
    # unless a later exec completes.
    exec("")
