"""MAVLink telemetry logs and links: frames, dialects, signatures, clocks."""
