"""The page in the browser: drop a log, see the verdict; the fleet at a glance."""

from mavhums.serve.options import Fleet, Quotas, ServeOptions
from mavhums.serve.server import serve

__all__ = ["Fleet", "Quotas", "ServeOptions", "serve"]
