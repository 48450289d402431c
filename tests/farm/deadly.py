"""Evaluations that die of certain genomes, for tests: importable by workers and by the processes of trials."""

import contextlib
import os
import signal
import time
from pathlib import Path

import numpy as np

from fractal_farm.evolution.epoch import Scores
from fractal_farm.farm.trials import refused
from fractal_farm.farm.work import evaluate_candidates


def deadly(genes):
    """Whether a genome is one of those that kill: about one in eighty."""
    return genes[:, 0, 0].view(np.uint64) % np.uint64(79) == 0


def _seldom(candidates):
    return np.ascontiguousarray(candidates.genes)[:, 0, 0].view(np.uint64) % np.uint64(199) == 0


def dies_seldom(candidates, config):
    """Dies of one in two hundred, whatever is asked about them."""
    if _seldom(candidates).any():
        os.kill(os.getpid(), signal.SIGSEGV)
    return evaluate_candidates(candidates, config)


def refuses_seldom(candidates, config):
    """Refuses the same genomes, and lives."""
    return _refusing(candidates, config, _seldom(candidates))


def dies(candidates, config):
    """Dies by its own hand of every deadly genome."""
    if deadly(np.ascontiguousarray(candidates.genes)).any():
        os.kill(os.getpid(), signal.SIGSEGV)
    return evaluate_candidates(candidates, config)


def refuses(candidates, config):
    """Refuses the same genomes, and lives."""
    return _refusing(candidates, config, deadly(np.ascontiguousarray(candidates.genes)))


def _refusing(candidates, config, at):
    scores = evaluate_candidates(candidates, config)
    values, refusals = scores.values.copy(), scores.refusals.copy()
    values[at], refusals[at] = refused().values[0], refused().refusals[0]
    return Scores(values, refusals, scores.descriptors)


def is_killed(candidates, config):
    """Killed from outside again and again, except in small batches."""
    if len(candidates.n_maps) > 16:
        os.kill(os.getpid(), signal.SIGKILL)
    return evaluate_candidates(candidates, config)


def never_ends(candidates, config):
    """Does not come to an end with a deadly genome."""
    while deadly(np.ascontiguousarray(candidates.genes)).any():
        pass
    return evaluate_candidates(candidates, config)


def dies_of_everything(candidates, config):
    """A broken machine."""
    os.kill(os.getpid(), signal.SIGILL)


def waits_once(path, candidates, config):
    """The first process that evaluates a larger batch waits for ever."""
    if len(candidates.n_maps) > 2:
        with contextlib.suppress(FileExistsError), Path(path).open("x"):
            time.sleep(3600.0)
    return evaluate_candidates(candidates, config)
