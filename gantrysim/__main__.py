"""`python -m gantrysim`."""

from gantrysim.cli import main

main()
