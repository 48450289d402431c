"""`farm lineage`: the ancestors or descendants of a design, and which designs and operators led on."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.output import AsJson, print_json, print_table, print_tree, say
from fractal_farm.errors import InputError
from fractal_farm.ifs.symmetry import NO_SYMMETRY

if TYPE_CHECKING:
    from fractal_farm.catalogue.lineage import Lineage
    from fractal_farm.catalogue.pedigree import Pedigree, Relative

_TREE_DEPTH = 4
_FERTILE = 10
_SHORT = 8


class TreeFormat(enum.StrEnum):
    """How a family is written."""

    TEXT = "text"
    DOT = "dot"
    JSON = "json"


def lineage(
    directory: DirectoryArgument,
    design: Annotated[
        str | None,
        typer.Argument(metavar="[ID]", help="Design, or the first digits of its id; without one: what led on."),
    ] = None,
    descendants: Annotated[bool, typer.Option("--descendants", help="What came of the design, not whence.")] = False,
    depth: Annotated[
        int | None,
        typer.Option(min=1, help="Steps to follow; default: 4 in a tree, all in a file.", show_default=False),
    ] = None,
    form: Annotated[TreeFormat, typer.Option("--format", help="How to write it.")] = TreeFormat.TEXT,
    gap: Annotated[
        float, typer.Option(min=0, help="Widest gap that prints in one piece: wall over size.", show_default="0.8/30")
    ] = 0.8 / 30,
    as_json: AsJson = False,
) -> None:
    """Show where a design comes from; without ID, which ancestors and operators led on."""
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.lineage import read_lineage
    from fractal_farm.catalogue.pedigree import pedigree

    form = TreeFormat.JSON if as_json else form
    catalogue = Catalogue.open(directory)
    if design is None and form is TreeFormat.DOT:
        raise InputError("--format dot: draws the family of one design; give its ID")
    found = read_lineage(catalogue)
    if design is None:
        _print_summary(found, gap, form)
        return
    if depth is None and form is TreeFormat.TEXT:
        depth = _TREE_DEPTH
    family = pedigree(found, found.find(design), "descendants" if descendants else "ancestors", depth)
    if form is TreeFormat.DOT:
        typer.echo(_dot(family), nl=False)
    elif form is TreeFormat.JSON:
        print_json(_as_dict(family, descendants))
    else:
        _print_tree(family, descendants)


def _print_tree(family: Pedigree, descendants: bool) -> None:
    from rich.tree import Tree

    from fractal_farm.catalogue.pedigree import summary

    branches: list[Tree] = []
    for line in family.lines:
        del branches[line.level :]
        text = _text(family, line, descendants)
        branches.append(branches[-1].add(text) if branches else Tree(text))
    print_tree(branches[0])
    facts = summary(family)
    names = "descendants" if descendants else "ancestors"
    say(
        f"{names}: {facts['relatives']}, of them published: {facts['kept']}; steps: {facts['steps']}; "
        f"without parents: {facts['founders']}; links: {facts['links']}, between islands: {facts['between_islands']}"
    )


def _text(family: Pedigree, line: Relative, descendants: bool) -> str:
    from fractal_farm.catalogue.lineage import is_kept

    if line.row < 0:
        return f"{line.design_id[:_SHORT]}  not in the catalogue"
    facts = family.facts[line.row]
    words = [
        line.design_id[:_SHORT],
        f"{facts['fitness']:.4f}",
        facts["operator"],
        *_birth(facts, "island", "epoch", "generation"),
    ]
    if facts["symmetry"] not in (None, NO_SYMMETRY):
        words.append(facts["symmetry"])
    if line.migrated_from is not None:
        words.append(f"its parent came from island {line.migrated_from}" if descendants else "migrated")
    if not is_kept(facts):
        words.append("not published")
    if line.again:
        words.append("(shown elsewhere)")
    if line.folded:
        words.append(f"... {line.folded} more")
    return "  ".join(words)


def _birth(facts: dict[str, Any], *names: str) -> list[str]:
    """Where a design was born; nothing for one that was made by hand."""
    return [] if facts["island"] is None else [" ".join(f"{name} {facts[name]}" for name in names)]


def _dot(family: Pedigree) -> str:
    """The family in Graphviz' language, parents above; links between islands are dashed."""
    lines = ["digraph lineage {", "  node [shape=box];"]
    for facts in family.facts.values():
        label = f"{facts['design_id'][:_SHORT]}\\n{facts['fitness']:.4f} {facts['operator']}" + "".join(
            f"\\n{place}" for place in _birth(facts, "island")
        )
        lines.append(f'  "{facts["design_id"]}" [label="{label}"];')
    for line in family.lines:
        if line.row < 0:
            lines.append(f'  "{line.design_id}" [label="{line.design_id[:_SHORT]}\\nnot recorded", style=dotted];')
    for parent, child, migrated in family.edges():
        lines.append(f'  "{parent}" -> "{child}"{" [style=dashed]" if migrated else ""};')
    return "\n".join([*dict.fromkeys(lines), "}"]) + "\n"


def _as_dict(family: Pedigree, descendants: bool) -> dict[str, Any]:
    from fractal_farm.catalogue.pedigree import summary

    return {
        "design_id": family.lines[0].design_id,
        "direction": "descendants" if descendants else "ancestors",
        "summary": summary(family),
        "designs": [{**facts, "steps": family.steps[row]} for row, facts in family.facts.items()],
        "links": [
            {"parent": parent, "child": child, "between_islands": migrated}
            for parent, child, migrated in family.edges()
        ],
    }


def _print_summary(found: Lineage, gap: float, form: TreeFormat) -> None:
    from dataclasses import asdict

    from fractal_farm.catalogue.fertility import most_fertile, operator_yields

    yields = operator_yields(found, gap)
    ancestors = most_fertile(found, _FERTILE, gap)
    rows = found.facts([ancestor.row for ancestor in ancestors])
    if form is TreeFormat.JSON:
        fertile = [{**facts, **asdict(entry)} for facts, entry in zip(rows, ancestors, strict=True)]
        print_json({"gap": gap, "operators": [asdict(entry) for entry in yields], "fertile": fertile})
        return
    print_table(
        ["operator", "maps", "published", "fitness", "gain", "printable", "fertile", "only ancestors"],
        [
            [e.operator, e.n_maps, e.published, e.mean_fitness, e.gain, e.printable, e.fertile, e.ancestors]
            for e in yields
        ],
    )
    typer.echo()
    print_table(
        ["ancestor", "fitness", "operator", "island", "epoch", "children", "descendants", "their fitness", "printable"],
        [
            [
                facts["design_id"],
                facts["fitness"],
                facts["operator"],
                facts["island"],
                facts["epoch"],
                entry.children,
                entry.descendants,
                entry.mean_fitness,
                entry.printable,
            ]
            for facts, entry in zip(rows, ancestors, strict=True)
        ],
    )
    say(
        f"\nCounted are the {sum(entry.published for entry in yields)} published designs: mean fitness, gain over the "
        f"fitter parent, share with a gap up to {gap:.4f}, share that are parents in turn; and ancestors that were not "
        "published themselves. Candidates that came to nothing left no row: these are counts of successes, not rates."
    )
