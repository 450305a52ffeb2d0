"""``python -m tradestudy``."""

from tradestudy.cli import main

main()
