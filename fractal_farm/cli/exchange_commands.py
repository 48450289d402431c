"""`farm compact`, `farm export` and `farm merge`: whole catalogues, tidied, published and put together."""

from __future__ import annotations

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.output import AsJson, byte_count, print_json, say


def compact(directory: DirectoryArgument, as_json: AsJson = False) -> None:
    """Merge small files of the manifest into large ones: a large catalogue is read many times faster.

    Nothing that a catalogue tells is changed. Runs do this themselves as they grow.
    """
    from fractal_farm.catalogue.compaction import compact_all

    done = compact_all(directory)
    if as_json:
        print_json({"before": done.before, "after": done.after, "bytes": done.bytes})
    elif done.before:
        saved = f"{byte_count(abs(done.bytes))} {'more' if done.bytes > 0 else 'less'}"
        say(f"merged {done.before:,} files of the manifest into {done.after:,}, {saved}")
    else:
        say("nothing to merge")
