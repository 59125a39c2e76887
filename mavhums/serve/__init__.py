"""The page in the browser: drop a log, see the verdict; the fleet at a glance."""
