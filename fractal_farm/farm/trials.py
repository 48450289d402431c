"""What becomes of a batch that keeps killing its worker (DESIGN section 4).

A batch that was lost is done again; if it is lost again it is cut in halves, down to single genomes. A genome that is
still lost gets trials, each in a process of its own whose end can be told apart: three deaths by its own signal, or
beyond its bound of processor time, set it aside. Who was killed from outside, or lost with its machine, is tried again.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from fractal_farm.config import EvolutionConfig
from fractal_farm.errors import FarmError
from fractal_farm.evolution.designs import SCORE_FIELDS
from fractal_farm.evolution.epoch import Candidates, Scores
from fractal_farm.farm.work import Evaluate, SetAside, joined, sample_candidates
from fractal_farm.ifs.genome import Refusal

DEATHS = 3
_LOSSES = 2  # of a whole batch, before it is cut
_TRIALS = 100  # of one genome, whatever ends them
_STARTING_SECONDS = 10.0
_SECONDS_A_POINT = 4e-6  # fifty times what the slowest machine takes
# Sent by people, supervisors and the kernel's memory killer.
_FROM_OUTSIDE = frozenset(
    {signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2}
)


@dataclass(frozen=True)
class Death:
    """How a trial ended that gave no scores.

    Attributes:
        signal: what killed its process; `signal.SIGPROF` is the bound of processor time.
        control: so did the trial of a sound genome that went before it.
    """

    signal: int
    control: bool = False


def evaluate_with_care(
    batches: Sequence[Candidates],
    evaluate_all: Callable[[Sequence[Candidates]], Sequence[Scores | None]],
    try_alone: Callable[[Candidates], Scores | Death],
    config: EvolutionConfig,
) -> tuple[Scores, list[SetAside]]:
    """The scores of all batches, put together, whoever dies of them.

    Args:
        batches: what to evaluate.
        evaluate_all: evaluates batches side by side; None for one whose worker was lost.
        try_alone: runs `trial` on a single genome, somewhere.
        config: says how genomes are read.

    Returns:
        The scores in the order of the batches, and the genomes among them that were set aside.

    Raises:
        FarmError: evaluations die whatever the genome, or are killed from outside again and again.
    """
    found: dict[tuple[int, int], Scores] = {}
    set_aside: list[SetAside] = []
    waiting = [((number, 0), batch, _LOSSES) for number, batch in enumerate(batches)]
    while waiting:
        results = evaluate_all([batch for _, batch, _ in waiting])
        lost = []
        for (place, batch, patience), scores in zip(waiting, results, strict=True):
            if scores is not None:
                found[place] = scores
            elif patience > 1:
                lost.append((place, batch, patience - 1))
            elif len(batch.n_maps) == 1:
                found[place], verdict = _verdict(batch, try_alone, config)
                set_aside += verdict
            else:
                half = len(batch.n_maps) // 2
                number, first = place
                ahead, behind = batch.part(slice(half)), batch.part(slice(half, None))
                lost += [(place, ahead, 1), ((number, first + half), behind, 1)]
        waiting = lost
    return joined([found[place] for place in sorted(found)]), set_aside


def evaluate_apart(evaluate: Evaluate, block: Candidates, config: EvolutionConfig) -> tuple[Scores, list[SetAside]]:
    """The scores of genomes of which a process has died, without dying of them; see `evaluate_with_care`."""

    def apart(batches: Sequence[Candidates]) -> list[Scores | None]:
        outcomes = [trial(evaluate, batch, config) for batch in batches]
        return [outcome if isinstance(outcome, Scores) else None for outcome in outcomes]

    return evaluate_with_care([block], apart, lambda single: trial(evaluate, single, config), config)


def _verdict(
    single: Candidates, try_alone: Callable[[Candidates], Scores | Death], config: EvolutionConfig
) -> tuple[Scores, list[SetAside]]:
    deaths: list[int] = []
    for _ in range(_TRIALS):
        outcome = try_alone(single)
        if isinstance(outcome, Scores):
            return outcome, []
        if outcome.signal in _FROM_OUTSIDE:
            continue
        if outcome.control:
            raise FarmError(
                f"evaluations die of {_name(outcome.signal)} on this machine whatever the genome; see `farm doctor`"
            )
        deaths.append(outcome.signal)
        if len(deaths) == DEATHS:
            (genome,) = single.genomes(config.phenotype.phenotype())
            rows = tuple(tuple(row) for row in genome.genes.tolist())
            reason = f"its evaluation, run alone, ended with {', '.join(_name(number) for number in deaths)}"
            return refused(), [SetAside(genome.design_id, rows, reason)]
    raise FarmError(f"an evaluation was killed from outside {_TRIALS} times; end what kills it, then resume")


def refused() -> Scores:
    """What stands in place of the scores of a genome that was set aside."""
    scores = Scores.unknown(1)
    scores.values[0, SCORE_FIELDS.index("fitness")] = 0.0
    scores.refusals[0] = Refusal.SET_ASIDE
    return scores


def trial(evaluate: Evaluate, candidates: Candidates, config: EvolutionConfig) -> Scores | Death:
    """Evaluate genomes in a process of its own, after sound ones that show that the process works.

    Raises:
        FarmError: the evaluation raised an error, which is no death.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_alone, args=(theirs, evaluate, candidates, config))
    process.start()
    theirs.close()
    heard: list[Any] = []
    with contextlib.suppress(EOFError), ours:
        while True:
            heard.append(ours.recv())
    process.join()
    if len(heard) == 2:
        return Scores(*heard[1])
    code = process.exitcode or 0
    if code >= 0:
        raise FarmError(f"an evaluation ended with exit code {code} and no scores; see the Ray logs")
    return Death(-code, control=not heard)


def _alone(theirs: Any, evaluate: Evaluate, candidates: Candidates, config: EvolutionConfig) -> None:
    """In the child: what is sent are scores, first of sound genomes, then of those in question."""
    theirs.send(tuple(evaluate(sample_candidates(config), config)))
    with bounded(len(candidates.n_maps), config):
        theirs.send(tuple(evaluate(candidates, config)))


@contextlib.contextmanager
def bounded(genomes: int, config: EvolutionConfig) -> Any:
    """End this process when it takes far more processor time than so many evaluations can; see `Death.signal`."""
    bound_s = _STARTING_SECONDS + genomes * _SECONDS_A_POINT * config.phenotype.points
    signal.setitimer(signal.ITIMER_PROF, bound_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _name(number: int) -> str:
    if number == signal.SIGPROF:
        return "its bound of processor time exceeded"
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
