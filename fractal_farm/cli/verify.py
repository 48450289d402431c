"""`farm verify` and `farm reproduce`: is a catalogue as it was written, and what its genomes give again?"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from fractal_farm.cli.catalogue_commands import DesignArgument, DirectoryArgument
from fractal_farm.cli.output import AsJson, print_json, print_table, say
from fractal_farm.errors import FarmError, InputError

if TYPE_CHECKING:
    from fractal_farm.catalogue.verify import Finding, Level, Remakers, Report

_SHOWN_DESIGNS = 3


def verify(
    directory: DirectoryArgument,
    level: Annotated[
        str | None, typer.Argument(metavar="[quick|full|deep]", help="How thoroughly; default: full.")
    ] = None,
    level_option: Annotated[
        str | None, typer.Option("--level", help="The same, as an option.", show_default=False)
    ] = None,
    mend: Annotated[bool, typer.Option("--repair", help="Restore what can be, move aside what cannot.")] = False,
    as_json: AsJson = False,
) -> int:
    """Check that nothing in a catalogue was lost or changed.

    quick: names, sizes, the manifest. full: every byte. deep: every cloud and every score is computed again.

    Exit code 0: sound, or wholly restored. 1: damage found. 3: damage that could not be undone.
    """
    from fractal_farm.catalogue.verify import repair
    from fractal_farm.catalogue.verify import verify as look

    chosen = _level(level, level_option)
    report = repair(directory, chosen, _remakers(directory)) if mend else look(directory, chosen)
    if as_json:
        print_json(report.as_dict())
    else:
        for finding in report.findings:
            typer.echo(_line(finding))
        say(_summary(report))
    return report.exit_code


def reproduce(directory: DirectoryArgument, design: DesignArgument, as_json: AsJson = False) -> int:
    """Grow and score a design again: is the cloud the same to the bit, are the scores equal?

    Exit code 0: all is the same. 1: something differs.
    """
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.verify.reproduction import reproduce as again

    outcome = again(Catalogue.open(directory), design)
    differing = [quantity.name for quantity in outcome.quantities if not quantity.same]
    if as_json:
        print_json({**asdict(outcome), "same": outcome.same})
    else:
        rows = [[q.name, _digits(q.recorded), _digits(q.again), q.same] for q in outcome.quantities]
        print_table(["quantity", "recorded", "again", "same"], rows)
    if differing:
        say(f"{outcome.design_id}: {', '.join(differing)} differ; another machine or version may compute other bits")
        return 1
    cloud = f"the cloud of {outcome.n_points} points is identical to the bit, " if outcome.n_points else ""
    say(f"{outcome.design_id}: {cloud}all scores are equal")
    return 0


def _digits(value: object) -> str:
    """A value with all its digits; of a list only its length."""
    if isinstance(value, list):
        return f"{len(value)} numbers"
    return repr(value) if isinstance(value, float) else str(value)


def _level(argument: str | None, option: str | None) -> Level:
    from fractal_farm.catalogue.verify import Level

    if argument and option and argument != option:
        raise InputError(f"level {argument} and --level {option}: leave one of them out")
    for known in get_args(Level):
        if (argument or option or "full") == known:
            return known  # type: ignore[no-any-return]
    raise InputError(f"--level {argument or option}: choose {', '.join(get_args(Level))}")


def _remakers(directory: Path) -> Remakers:
    from fractal_farm.catalogue.verify import Remakers
    from fractal_farm.config import RunConfig

    def configuration() -> RunConfig:
        from fractal_farm.catalogue.settings import read_settings
        from fractal_farm.farm.stopping import chosen_run

        return RunConfig.from_dict(read_settings(directory, chosen_run(directory, None)), f"{directory}: run.json")

    def sheet() -> None:
        from fractal_farm.farm.sheet import write_sheet

        write_sheet(directory, configuration())

    def report() -> None:
        from fractal_farm.farm.report import write_report

        write_report(directory, configuration())

    def solid(design_id: str, parameters_hash: str) -> Mapping[str, bytes]:
        from fractal_farm.catalogue import Catalogue
        from fractal_farm.catalogue.settings import read_settings
        from fractal_farm.farm.work import MeshOrder, made_solid

        catalogue = Catalogue.open(directory)
        runs = catalogue.runs()
        configurations = [run.description["config"] for run in runs]
        configurations += [read_settings(directory, run.run_id) for run in runs]
        for values in configurations:
            settings = RunConfig.from_dict(values, f"{directory}: run.json").solids
            parameters = settings.parameters
            if parameters.hash == parameters_hash:
                return made_solid(
                    MeshOrder(catalogue.genome(design_id), parameters, settings.formats, settings.material)
                )
        raise FarmError("no run of this catalogue makes solids with these parameters; make it again with `farm mesh`")

    return Remakers({"catalogue.png": sheet, "report.html": report}, solid)


def _line(finding: Finding) -> str:
    """A finding in one line: where, what, whom it concerns, what would mend it or did."""
    whom = ""
    if finding.designs:
        ids = [identity[:8] for identity in finding.designs[:_SHOWN_DESIGNS]]
        more = ", ..." if len(finding.designs) > _SHOWN_DESIGNS else ""
        count = len(finding.designs)
        whom = f" ({count} design{'s' if count > 1 else ''}: {', '.join(ids)}{more})"
    line = f"{finding.path}: {finding.problem}{whom}; {finding.outcome or finding.remedy}"
    return json.dumps(line, ensure_ascii=False)[1:-1].replace('\\"', '"')


def _summary(report: Report) -> str:
    """What it comes to, in one line."""
    looked = f"{report.level}: {report.files} files, {report.bytes / 1e6:.1f} MB compared, {report.designs} designs"
    digest = f", digest {report.digest}" if report.digest else ""
    damaged = sum(finding.damage for finding in report.findings)
    others = len(report.findings) - damaged
    noted = f", {others} other {'thing' if others == 1 else 'things'} noted" if others else ""
    if report.repaired and damaged:
        lost = sum(finding.lost for finding in report.findings)
        verdict = f"{damaged - lost} of {damaged} damages undone" + (f", {lost} remain" if lost else "")
    else:
        verdict = f"{damaged} damage{'s' if damaged != 1 else ''} found" if damaged else "sound"
    return f"{verdict}{noted} ({looked}{digest})"
