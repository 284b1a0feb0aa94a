"""`python -m gantrysim`."""

from gantrysim.cli.start import main

main()
