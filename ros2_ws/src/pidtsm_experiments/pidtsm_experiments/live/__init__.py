"""The live page: a running system in the browser, with its knobs."""
