"""Hypothesis for compiled code: no deadlines, and no tracing of it to explain a failure, which takes for ever."""

from hypothesis import Phase, settings

settings.register_profile("compiled", deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
settings.load_profile("compiled")
