"""One module a log format: its tables into the signals of :mod:`mavhums.vehicle.signals`."""
