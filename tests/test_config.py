"""The run configuration: what is refused and how it is said, what is the identity of a run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.config import EvolutionConfig, RunConfig, load_genomes
from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Phenotype
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.presets import preset as solid_preset

CONFIGS = Path(__file__).parents[1] / "configs"
PRESETS = ("quickstart", "paper", "overnight")
VALID_ROWS = [[0.1, 0.2, 0.3, 0.5, 1.0, 0.0, 0.0], [0.1, 0.2, 0.3, 0.4, -1.0, 0.5, 0.0]]


def refusal(directory: Path, text: str, *overrides: str) -> str:
    """The message that a configuration is refused with; it is one line and names the file or the option."""
    path = directory / "run.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        RunConfig.from_yaml(path, overrides)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith((str(path), "--set")), message
    return message


@pytest.mark.parametrize(
    ("text", "key", "value", "remedy"),
    [
        ("evolution: {ofspring: 3}", "evolution.ofspring", "unknown key", "did you mean 'offspring'"),
        ("evolutoin: {}", "evolutoin", "unknown key", "did you mean 'evolution'"),
        ("zzz: 1", "zzz", "unknown key", "name, evolution, stop, execution, catalogue, solids"),
        ("evolution: {library: {size: 0}}", "evolution.library.size", "0", "whole number from 2"),
        ("evolution: {islands: 0}", "evolution.islands", "0", "whole number from 1"),
        ("evolution: {islands: 1.0}", "evolution.islands", "1.0", "whole number"),
        ("evolution: {seed: true}", "evolution.seed", "true", "whole number from 0"),
        ('evolution: {seed: "5"}', "evolution.seed", "'5'", "whole number"),
        ("evolution: {elimination: 1.5}", "evolution.elimination", "1.5", "from 0 to 1"),
        ("evolution: {crossover: {probability: -0.1}}", "evolution.crossover.probability", "-0.1", "from 0 to 1"),
        ("evolution: {mutation: {sigma: 0}}", "evolution.mutation.sigma", "0", "above 0"),
        ("evolution: {migration: {lag: 0}}", "evolution.migration.lag", "0", "from 1"),
        ("evolution: {migration: {topology: star}}", "topology", "'star'", "ring, full, random or isolated"),
        ("evolution: {migration: {selection: worst}}", "selection", "'worst'", "best or random"),
        ("evolution: {phenotype: {points: 499}}", "evolution.phenotype.points", "499", "from 500 to 200000"),
        ("evolution: {phenotype: {rotation_sign: true}}", "rotation_sign", "true", "1 or -1"),
        ("evolution: {phenotype: {influence: 0.5}}", "influence", "0.5", "from 1"),
        ("evolution: {fitness: {d0: [0.3, 0]}}", "evolution.fitness.d0.1", "0", "above 0"),
        ("evolution: {fitness: {d0: [0.3]}}", "evolution.fitness.d0", "[0.3]", "[a number, a number above 0]"),
        ("evolution: {fitness: {lle: .nan}}", "evolution.fitness.lle", "nan", "a number"),
        ("evolution: {library: {map_counts: {1: 1.0}}}", "map_counts", "key 1", "from 2 to 8"),
        ("evolution: {library: {map_counts: {2: 0.9}}}", "map_counts", "{2: 0.9}", "sum is 1"),
        ("evolution: {similarity_dimension: [3, 1]}", "similarity_dimension", "[3.0, 1.0]", "low below high"),
        ("evolution: {elimination: 0.9}", "elimination", "0.9", "qualified 0.85"),
        ("evolution: {offspring: 8, accepted: 2}", "offspring and accepted", "8 and 2", "one of them"),
        ("evolution: {offspring: null}", "offspring and accepted", "null", "one of them"),
        ("evolution: {migration: {emigrants: 101}}", "migration.emigrants", "101", "library.size 100"),
        ("evolution: [1]", "evolution", "[1]", "a section with seed"),
        ("stop: {hours: 0}", "stop.hours", "0", "above 0"),
        ("stop: {hours: .inf}", "stop.hours", "inf", "a number"),
        ("execution: {workers: 0}", "execution.workers", "0", "from 1"),
        ("execution: {executor: serial, address: auto}", "address", "'auto'", "executor ray"),
        ("catalogue: {durability: none}", "catalogue.durability", "'none'", "full or process"),
        ("solids: {formats: [step]}", "solids.formats.0", "'step'", "glb, 3mf, stl, ply or obj"),
        ("solids: {formats: [glb, glb]}", "formats", "[glb, glb]".replace("glb", "'glb'"), "once"),
        ("solids: {preset: pendant-lead}", "preset", "'pendant-lead'", "choose from pendant-silver"),
        ("solids: {base: foot}", "base", "'foot'", "none, plate"),
        ("solids: {shell_mm: 0.1}", "shell_mm", "0.1", "at least wall_mm"),
        ("solids: {preset: desk-nylon, sprue: true}", "sprue", "plate", "leave one out"),
        ("solids: {wall_mm: 10}", "wall_mm", "10", "from 0.225 to below 10"),
        ("name: ../elsewhere", "name", "'../elsewhere'", "letters, digits"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_one_line_with_key_value_and_remedy(
    tmp_path: Path, text: str, key: str, value: str, remedy: str
) -> None:
    message = refusal(tmp_path, text)
    assert key in message
    assert value in message
    assert remedy in message


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty"),
        ("- 1", "a list"),
        ("a: 1\na: 2", "line 2, column 1: the key 'a' appears twice"),
        ("a: [1, 2", "line 1"),
        ("a: &x [1]\nb: *x", "line 2, column 4: *aliases are not read"),
        ("a: {? [1]: 2}", "a key must be a word"),
        ("a: !!python/object/apply:os.system ['true']", "could not determine a constructor"),
        ("[" * 5000, "nested too deeply"),
        ("a: 2020-13-41", "not readable"),
        ("name: \x00", "special characters"),
        ("a: " + "x" * (1 << 20), "larger than 1 MiB"),
    ],
)
def test_a_broken_file_is_one_line(tmp_path: Path, text: str, reason: str) -> None:
    assert reason in refusal(tmp_path, text)


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        RunConfig.from_yaml(tmp_path / "nowhere.yaml")
    with pytest.raises(InputError, match="is a directory"):
        RunConfig.from_yaml(tmp_path)
    (tmp_path / "run.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        RunConfig.from_yaml(tmp_path / "run.yaml")


plain_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5) | st.integers(), inner, max_size=3),
    max_leaves=6,
)


@given(
    section=st.sampled_from(["name", "evolution", "stop", "execution", "catalogue", "solids"]),
    field=st.sampled_from(sorted({*EvolutionConfig.model_fields, "epochs", "executor", "keep", "max", "x"})),
    value=plain_values,
)
def test_any_values_are_accepted_or_refused_in_one_line(section: str, field: str, value: Any) -> None:
    for tree in ({section: value}, {section: {field: value}}, {section: {"library": {"seeds": value}}}):
        try:
            config = RunConfig.from_dict(tree)
        except InputError as error:
            message = str(error)
        else:
            message = ""
            assert RunConfig.from_dict(config.to_dict()) == config
        assert "\n" not in message


@given(text=st.text(max_size=200))
def test_any_override_is_accepted_or_refused_in_one_line(text: str) -> None:
    for override in (text, f"evolution.seed={text}", f"{text}=1"):
        message = ""
        try:
            RunConfig.from_dict({}, overrides=[override])
        except InputError as error:
            message = str(error)
        assert "\n" not in message


def test_solids_follow_a_preset_and_what_is_given_goes_before_it() -> None:
    config = RunConfig.from_dict({"solids": {"preset": "pendant-gold", "size_mm": 28.0, "bail": "none"}})
    assert config.solids.parameters == solid_preset("pendant-gold", size_mm=28.0, bail="none")
    assert RunConfig().solids.parameters == SolidParameters()
    # Solids are no part of a run's identity.
    assert config.run_id == RunConfig().run_id
    stored = json.loads(json.dumps(config.to_dict()))
    other = RunConfig.from_dict(stored, overrides=["solids.preset=desk-nylon"])
    assert other.solids.parameters.base == "plate"


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_are_valid_and_survive_json(preset: str) -> None:
    config = RunConfig.from_yaml(CONFIGS / f"{preset}.yaml")
    assert config.name == preset
    restored = RunConfig.from_dict(json.loads(json.dumps(config.to_dict())))
    assert restored == config
    assert restored.run_id == config.run_id


def test_the_paper_preset_is_the_paper() -> None:
    evolution = RunConfig.from_yaml(CONFIGS / "paper.yaml").evolution
    assert (evolution.library.size, evolution.library.growth, evolution.accepted) == (100, "append", 10)
    assert (evolution.crossover.probability, evolution.mutation.probability) == (0.75, 0.5)
    assert (evolution.elimination, evolution.qualified) == (0.6, 0.85)
    assert evolution.similarity_dimension is None
    stop = RunConfig.from_yaml(CONFIGS / "paper.yaml").stop
    assert stop.epochs is not None
    assert stop.epochs * evolution.generations_per_epoch == 15


def test_defaults_are_those_of_the_design() -> None:
    config = RunConfig()
    assert config.evolution.method == "niches"
    assert config.catalogue.keep == "distinct"
    assert config.evolution.fitness.d2 == (0.5, 0.698)
    assert config.evolution.library.map_counts == {2: 0.5, 3: 0.5}
    assert config.evolution.phenotype.phenotype() == Phenotype()


def test_an_empty_section_means_its_defaults(tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text("name: run\nevolution:\nstop:\n")
    assert RunConfig.from_yaml(path) == RunConfig()


def test_accepted_alone_replaces_offspring() -> None:
    assert RunConfig.from_dict({"evolution": {"accepted": 10}}).evolution.offspring is None


def test_numbers_may_be_written_as_people_write_them(tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text("evolution: {elimination: 5e-1, mutation: {sigma: 1}}")
    evolution = RunConfig.from_yaml(path).evolution
    assert (evolution.elimination, evolution.mutation.sigma) == (0.5, 1.0)


def test_overrides_change_single_fields(tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text("evolution: {seed: 1, library: {size: 10}, migration: {emigrants: 2}}")
    config = RunConfig.from_yaml(path, ["evolution.seed=7", "stop.epochs=3", "evolution.library.map_counts={3: 1.0}"])
    assert (config.evolution.seed, config.stop.epochs, config.evolution.library.size) == (7, 3, 10)
    assert config.evolution.library.map_counts == {3: 1.0}


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("evolution.seed=a", ["--set: evolution.seed is 'a'", "whole number"]),
        ("evolution.sed=3", ["--set: unknown key evolution.sed", "did you mean 'seed'"]),
        ("seed", ["--set seed", "write section.field=value"]),
        ("=3", ["--set =3", "write section.field=value"]),
        ("name.y=3", ["--set name.y=3", "name is 'run'"]),
        ("evolution.seed=[1", ["--set evolution.seed=[1", "column 3"]),
        ("evolution.accepted=4", ["with --set", "offspring and accepted are 8 and 4"]),
    ],
)
def test_a_wrong_override_is_named(tmp_path: Path, override: str, parts: list[str]) -> None:
    message = refusal(tmp_path, "name: run\nevolution: {offspring: 8}", override)
    for part in parts:
        assert part in message


def test_run_id_depends_neither_on_order_nor_on_comments_nor_on_notation(tmp_path: Path) -> None:
    first, second = tmp_path / "a.yaml", tmp_path / "b.yaml"
    first.write_text("evolution:\n  seed: 3   # lucky\n  elimination: 0.5\n  mutation: {sigma: 1, probability: 0.5}\n")
    second.write_text("evolution: {mutation: {probability: 5.0e-1, sigma: 1.0}, elimination: 0.50, seed: 3}\n")
    assert RunConfig.from_yaml(first).run_id == RunConfig.from_yaml(second).run_id


def test_run_id_is_16_hex_digits() -> None:
    assert len(RunConfig().run_id) == 16
    assert int(RunConfig().run_id, 16) >= 0


OTHER_VALUES: dict[str, Any] = {
    "seed": 1, "method": "random", "islands": 3, "generations_per_epoch": 1, "offspring": 7, "elimination": 0.1,
    "qualified": 0.9, "similarity_dimension": None, "library.size": 9, "library.growth": "append",
    "library.seeds": [VALID_ROWS], "library.map_counts": {2: 1.0}, "crossover.probability": 0.1,
    "mutation.probability": 0.1, "mutation.sigma": 0.5, "mutation.repair": "clip", "crossover.kind": "sequence",
    "migration.topology": "full", "migration.degree": 1, "migration.lag": 2, "migration.emigrants": 1,
    "migration.selection": "random", "migration.replacement": "worst",
    "phenotype.family": "affine", "phenotype.points": 1000, "phenotype.influence": 2.0,
    "phenotype.map_form": "rho R x + d", "phenotype.rotation_sign": -1, "fitness.amplitude": 1.0,
    "niches.capacity": 9, "niches.gap": 0.1, "niches.crossover": 0.1, "niches.probabilities": [0.1],
    "niches.sigmas": [0.5], "niches.gap_attempts": 1, "niches.expected_fitness": None,
    "niches.foreseen_distance": None, "niches.fullness": None, "symmetries": {"none": 0.5, "rotation:6": 0.5},
    "fitness.baseline": 0.0, "fitness.d0": [0.3, 0.8], "fitness.d2": [0.4, 0.7], "fitness.lle": [0.0, 1.0],
}  # fmt: skip


def test_run_id_depends_on_every_field_of_evolution() -> None:
    ids = {RunConfig().run_id}
    for key, value in OTHER_VALUES.items():
        ids.add(RunConfig.from_dict({}, overrides=[f"evolution.{key}={json.dumps(value)}"]).run_id)
    ids.add(RunConfig.from_dict({"evolution": {"accepted": 5}}).run_id)
    seeds = {"seeds": [VALID_ROWS], "seed_symmetries": ["mirror"]}
    ids.add(RunConfig.from_dict({"evolution": {"library": seeds}}).run_id)
    assert len(ids) == len(OTHER_VALUES) + 3
    leaves = {
        f"{name}.{inner}" if hasattr(field.annotation, "model_fields") else name
        for name, field in EvolutionConfig.model_fields.items()
        for inner in (getattr(field.annotation, "model_fields", None) or [""])
    }
    assert leaves == {*OTHER_VALUES, "accepted", "library.seed_symmetries"}


@pytest.mark.parametrize(
    "override",
    ["name=other", "stop.epochs=3", "stop.hours=1", "execution.executor=serial", "execution.workers=1",
     "execution.batch_size=8", "catalogue.keep=accepted", "catalogue.durability=process", "solids.max=0",
     "solids.size_mm=20"],
)  # fmt: skip
def test_run_id_depends_on_nothing_else(override: str) -> None:
    assert RunConfig.from_dict({}, overrides=[override]).run_id == RunConfig().run_id


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1))
def test_seeds_have_ids_of_their_own(one: int, other: int) -> None:
    ids = [RunConfig.from_dict({"evolution": {"seed": seed}}).run_id for seed in (one, other)]
    assert (ids[0] == ids[1]) == (one == other)


def test_seeds_are_stored_by_content(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    for place, name in ((tmp_path, "genomes.yaml"), (tmp_path / "below", "others.yaml")):
        (place / name).write_text(yaml.safe_dump({"genomes": {name: VALID_ROWS}}))
        (place / "run.yaml").write_text(f"evolution: {{library: {{seeds: {name}}}}}")
    one = RunConfig.from_yaml(tmp_path / "run.yaml")
    other = RunConfig.from_yaml(tmp_path / "below" / "run.yaml")
    inline = RunConfig.from_dict({"evolution": {"library": {"seeds": [VALID_ROWS]}}})
    np.testing.assert_array_equal(one.evolution.library.seeds, [VALID_ROWS])
    assert one.run_id == other.run_id == inline.run_id


def test_a_seed_that_is_no_contraction_is_refused(tmp_path: Path) -> None:
    rows = [VALID_ROWS[0], [0, 0, 0, 1.2, 0, 0, 0]]
    with pytest.raises(InputError, match=r"genome 1 map 2: rho is 1\.2; it must lie between 0 and 1"):
        RunConfig.from_dict({"evolution": {"library": {"seeds": [rows]}}})
    (tmp_path / "genomes.yaml").write_text(yaml.safe_dump({"genomes": {"spiral": rows}}))
    (tmp_path / "run.yaml").write_text("evolution: {library: {seeds: genomes.yaml}}")
    with pytest.raises(InputError, match=r"genomes.yaml: genome spiral map 2: rho is 1\.2"):
        RunConfig.from_yaml(tmp_path / "run.yaml")


def test_seeds_must_fit_the_library_and_the_phenotype(tmp_path: Path) -> None:
    (tmp_path / "genomes.yaml").write_text(
        yaml.safe_dump({"phenotype": {"rotation_sign": -1}, "genomes": {"a": VALID_ROWS}})
    )
    assert "phenotype differs" in refusal_of_seeds(tmp_path, "genomes.yaml")
    by_hand = {"genomes": {"a": {"genes": VALID_ROWS, "probabilities": [0.5, 0.5]}}}
    (tmp_path / "genomes.yaml").write_text(yaml.safe_dump(by_hand))
    assert "probabilities set by hand" in refusal_of_seeds(tmp_path, "genomes.yaml")
    assert "no such file" in refusal_of_seeds(tmp_path, "nowhere.yaml")
    message = refusal(
        tmp_path,
        yaml.safe_dump({"evolution": {"library": {"size": 2, "seeds": json.loads(json.dumps([VALID_ROWS] * 3))}}}),
    )
    assert "3 seeds do not fit a library of size 2" in message


def refusal_of_seeds(directory: Path, name: str) -> str:
    (directory / "run.yaml").write_text(f"evolution: {{library: {{seeds: {name}}}}}")
    with pytest.raises(InputError) as caught:
        RunConfig.from_yaml(directory / "run.yaml")
    assert str(directory / name) in str(caught.value)
    return str(caught.value)


def test_table_1_has_the_numbers_of_the_paper() -> None:
    genomes = dict(load_genomes(CONFIGS / "table1.yaml"))
    assert list(genomes) == ["06328", "06425", "06447", "06582"]
    assert [genome.n_maps for genome in genomes.values()] == [3, 3, 3, 2]
    np.testing.assert_array_equal(genomes["06582"].genes[1], [0.7182, -0.9256, 3.0556, 0.9677, 0.8829, -0.3807, 0.0029])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("genomes: {a: [[1, 2], [3]]}", "genome a: rows of 1, 2 numbers"),
        ("genomes: {a: [[1, x]]}", "genome a map 1: 'x' is not a number"),
        ("genomes: {a: [[1, true]]}", "genome a map 1: true is not a number"),
        ("genomes: {a: 3}", "genome a: genes are 3"),
        ("genomes: {a: []}", "genome a: genes are []"),
        ("genomes: {a: {gene: 3}}", "genome a: unknown key gene; allowed here: genes, probabilities"),
        ("genomes: {06425: []}", "genomes has the key 3349; allowed: names in quotes"),
        ("genomes: []", "genomes is []; allowed: a mapping"),
        ("{}", "genomes is missing"),
        ("genomes: {a: [[1]]}\nphenotype: {family: conformal}", "phenotype.family is 'conformal'"),
        ("genomes: {a: [[0, 0, 0, .nan, 0, 0, 0], [0, 0, 0, .5, 0, 0, 0]]}", "genome a map 1: rho is nan"),
        ("genomes: {a: [[0, 0, 0, 0.5, 0, 0, 0]]}", "genome a: shape (1, 7)"),
        (f"genomes: {{a: [[1{'0' * 400}]]}}", "genome a map 1: a number is too large"),
    ],
)  # fmt: skip
def test_a_wrong_genome_is_one_line_with_its_name(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "genomes.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_genomes(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert reason in message


def test_probabilities_set_by_hand_are_read(tmp_path: Path) -> None:
    path = tmp_path / "genomes.yaml"
    path.write_text(yaml.safe_dump({"genomes": {"a": {"genes": VALID_ROWS, "probabilities": [0.25, 0.75]}}}))
    assert load_genomes(path)[0][1].probabilities == (0.25, 0.75)
