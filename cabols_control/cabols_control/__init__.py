"""Control of cable-driven loading simulators."""
