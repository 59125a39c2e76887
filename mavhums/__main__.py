"""``python -m mavhums``."""

from mavhums.cli.main import main

if __name__ == "__main__":
    main()
