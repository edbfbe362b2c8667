"""`python -m levelhead` is the command line."""

from levelhead.cli.main import main

main()
