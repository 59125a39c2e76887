"""``python -m mavhums``."""

from mavhums.cli import main

if __name__ == "__main__":
    main()
