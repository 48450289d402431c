"""Small runs that the tests of the farm share."""

from fractal_farm.config import RunConfig
from fractal_farm.farm.events import Callback


def small_config(*overrides: str) -> RunConfig:
    """Three islands, eight epochs of tiny generations: seconds of work, with migration and qualified designs."""
    return RunConfig.from_dict(
        {
            "name": "small",
            "evolution": {
                "seed": 7,
                "method": "best",
                "islands": 3,
                "generations_per_epoch": 2,
                "offspring": 24,
                "library": {"size": 16},
                "migration": {"emigrants": 2},
                "phenotype": {"points": 1000},
                "elimination": 0.75,
            },
            "stop": {"epochs": 8},
            "catalogue": {"keep": "accepted", "min_free_gb": 0.1},
            "solids": {"max": 0},
        },
        overrides=overrides,
    )


class Recorder(Callback):
    """Remembers what happened."""

    def __init__(self):
        self.events = []

    def on_event(self, event):
        self.events.append(event)

    def of(self, kind):
        return [event for event in self.events if isinstance(event, kind)]
