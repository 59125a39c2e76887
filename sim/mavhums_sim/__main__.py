"""``python -m mavhums_sim``."""

from mavhums_sim.cli import main

if __name__ == "__main__":
    main()
