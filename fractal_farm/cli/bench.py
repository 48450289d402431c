"""`farm bench`: how fast and how exact the evaluator is on this machine."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from fractal_farm.cli.output import AsJson, check_writable, plain, print_json, print_table, say, write_file
from fractal_farm.errors import InputError

Output = Annotated[Path | None, typer.Option("--output", "-o", metavar="FILE", help="Also write the JSON there.")]


def bench(
    accuracy: Annotated[
        bool, typer.Option("--accuracy", help="Measure errors on known fractals instead (minutes).")
    ] = False,
    farm: Annotated[
        bool, typer.Option("--farm", help="Measure a run on Ray against plain loops instead (four minutes).")
    ] = False,
    solids: Annotated[
        bool, typer.Option("--solids", help="Measure solids of 200 and 400 voxels instead (two minutes).")
    ] = False,
    output: Output = None,
    as_json: AsJson = False,
) -> None:
    """Measure the evaluator: stages, whole evaluations, threads, sizes, peers; or errors, the whole farm, solids."""
    chosen = [name for name, wanted in (("accuracy", accuracy), ("farm", farm), ("solids", solids)) if wanted]
    if len(chosen) > 1:
        raise InputError(f"{' and '.join('--' + name for name in chosen)}: measure one at a time")
    if output is not None:
        check_writable(output)
    report = _accuracy() if accuracy else _efficiency() if farm else _solids() if solids else _speed()
    if as_json:
        print_json(report)
    elif accuracy:
        _print_accuracy(report)
    elif farm:
        _print_efficiency(report)
    elif solids:
        _print_solids(report)
    else:
        _print_speed(report)
    if output is not None:
        write_file(output, json.dumps(plain(report), indent=2).encode())
    if accuracy and not all(bound["met"] for bound in report["bounds"]):
        raise typer.Exit(1)


def _speed() -> dict[str, Any]:
    from fractal_farm.bench import peers, throughput
    from fractal_farm.bench.ceilings import measure_ceilings
    from fractal_farm.bench.stages import measure_stages
    from fractal_farm.bench.stopwatch import load, this_machine
    from fractal_farm.fitness.evaluation import POINTS

    loads = [load()]
    say("farm bench: compiling, then the limits of this machine")
    ceilings = measure_ceilings()
    say("farm bench: stages")
    stages = measure_stages(ceilings)
    say("farm bench: whole evaluations")
    whole, described = throughput.milliseconds(), throughput.milliseconds(described=True)
    sizes = throughput.by_size()
    say("farm bench: threads")
    loads.append(load())
    threads = throughput.by_threads(len(os.sched_getaffinity(0)))
    compared = []
    for peer in peers.compare():
        say(f"farm bench: {peer.peer}")
        compared.append(peer)
    loads.append(load())
    return {
        "machine": asdict(this_machine()),
        "load": loads,
        "ceilings": asdict(ceilings),
        "evaluation": {"points": POINTS, "milliseconds": whole, "milliseconds_with_descriptor": described},
        "stages": [asdict(stage) | {"ratio": stage.ratio} for stage in stages],
        "sizes": [{"points": size, "milliseconds": value} for size, value in sizes.items()],
        "threads": [asdict(scaling) for scaling in threads],
        "peers": [asdict(peer) for peer in compared],
        "missing": [] if peers.has_nolds() else [peers.MISSING],
    }


def _print_speed(report: dict[str, Any]) -> None:
    machine, ceilings = report["machine"], report["ceilings"]
    typer.echo(
        f"{machine['processor']}, {machine['cores']} cores, {machine['instruction_set']}, Python {machine['python']}; "
        f"{ceilings['clock'] / 1e9:.2f} GHz, {ceilings['bandwidth'] / 1e9:.0f} GB/s in the cache; "
        f"load {', '.join(f'{value:.1f}' for value in report['load'])}\n"
    )
    rows = [
        [s["name"], _digits(s["microseconds"]), _digits(s["floor"]), _digits(s["ratio"]), s["counted"]]
        for s in report["stages"]
    ]
    print_table(["stage, 5,000 points", "µs", "floor", "ratio", "the floor counts"], rows)
    whole = report["evaluation"]
    typer.echo(
        f"\nwhole evaluation {whole['milliseconds']:.3f} ms for a genome, "
        f"{whole['milliseconds_with_descriptor']:.3f} ms with its descriptor\n"
    )
    print_table(["points", "ms"], [[f"{s['points']:,}", _digits(s["milliseconds"])] for s in report["sizes"]])
    typer.echo()
    rows = [[t["threads"], f"{t['a_second']:,.0f}", f"{t['speedup']:.2f}"] for t in report["threads"]]
    print_table(["threads", "genomes a second", "x one"], rows)
    typer.echo()
    rows = [
        [p["work"], p["peer"], _digits(p["milliseconds"]), _digits(p["ours"]), f"{p['ratio']:,.0f}"]
        for p in report["peers"]
    ]
    print_table(["work", "peer", "ms", "ours, ms", "ratio"], rows)
    for line in report["missing"]:
        typer.echo(line)


def _accuracy() -> dict[str, Any]:
    from fractal_farm.bench.accuracy import measure_accuracy

    return measure_accuracy(say)


def _print_accuracy(report: dict[str, Any]) -> None:
    for table in report["tables"]:
        print_table(table["columns"], table["rows"], title=table["title"])
        typer.echo()
    rows = [
        ["ok" if b["met"] else "FAIL", b["name"], _digits(b["value"]), _digits(b["bound"])] for b in report["bounds"]
    ]
    print_table(["", "what", "measured", "bound"], rows)


def _efficiency() -> dict[str, Any]:
    from fractal_farm.bench.efficiency import measure_efficiency
    from fractal_farm.bench.stopwatch import load, this_machine
    from fractal_farm.cli.output import results_only_on_stdout

    before = load()
    say("farm bench: a run on Ray with storage and plain loops, in turn")
    with results_only_on_stdout():
        found = measure_efficiency()
    return {
        "machine": asdict(this_machine()),
        "load": [before],
        "farm": asdict(found),
    }


def _print_efficiency(report: dict[str, Any]) -> None:
    found = report["farm"]
    rows = [
        [*(f"{each[name]:,.0f}" for name in ("farm", "loops", "kernel")), f"{each['farm'] / each['loops']:.0%}"]
        for each in found["rounds"]
    ]
    typer.echo("candidates evaluated in a second on all cores")
    print_table(
        ["farm: Ray and storage", "plain loops, one a core", "the evaluations in them", "farm over loops"], rows
    )
    typer.echo(
        f"medians: farm over loops {found['of_loops']:.0%}, over evaluations {found['of_kernel']:.0%}; "
        f"load before {report['load'][0]:.1f}"
    )


def _solids() -> dict[str, Any]:
    from fractal_farm.bench.solids import measure_solids
    from fractal_farm.bench.stopwatch import load, this_machine

    before = load()
    costs = measure_solids(say)
    return {
        "machine": asdict(this_machine()),
        "load": [before],
        "solids": [asdict(cost) for cost in costs],
    }


def _print_solids(report: dict[str, Any]) -> None:
    solids = report["solids"]
    rows = [
        [
            *(f"{s['name']} at {s['resolution']}", *(_digits(seconds) for seconds in s["seconds"].values())),
            *(_digits(s["total"]), f"{s['peak_bytes'] / 1e6:,.0f}", f"{s['predicted_bytes'] / 1e6:,.0f}"),
        ]
        for s in solids
    ]
    print_table(
        ["seconds", *solids[0]["seconds"], "all", "peak, MB", "predicted"],
        rows,
        title="30 mm, wall 0.8 mm, each in a process of its own, with its interpreter and libraries",
    )
    typer.echo(f"load before {report['load'][0]:.1f}")


def _digits(value: float | None) -> str:
    """Three significant digits."""
    if value is None or value != value:
        return "-"
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
