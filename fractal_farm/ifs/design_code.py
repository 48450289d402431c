"""Design codes: a design's identity that a person can read out, engrave and type, such as FF-0E3E-RK8M-94CX-9.

Each group of four characters stands for five hex digits of the design id, in Crockford's base32: no I, L, O, U, and who
types I or L means 1, O means 0. The last character is a check over the others, a sum with weights in the field of
32 elements: it finds every single wrong character, and every swap of two.
"""

from __future__ import annotations

from fractal_farm.errors import InputError

MARK = "FF-"
GROUPS = 3

_ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
_MEANT = str.maketrans("ILO", "110", "- ")
_BITS = 5  # of a character
_FIELD = 1 << _BITS
_GROUP = 4
_HEX_GROUP = 5
_LONGEST = 6
_POLYNOMIAL = 0b100101  # x^5 + x^2 + 1, primitive: the powers of x are 31 different weights


def design_code(design_id: str, groups: int = GROUPS) -> str:
    """The code of a design.

    Three groups are 60 bits: in a catalogue of n designs two share a code with a probability of about n^2 / 2^61, 4e-7
    for a million. Two groups (40 bits) are shared by some two of a million with 0.4; a longer code tells those apart.

    Args:
        design_id: 32 hex digits.
        groups: of four characters, 1 to 6.
    """
    number = int(design_id[: _HEX_GROUP * groups], base=16)
    places = range(_GROUP * groups - 1, -1, -1)
    values = [number >> (_BITS * place) & (_FIELD - 1) for place in places]
    text = "".join(_ALPHABET[value] for value in values)
    parts = [text[start : start + _GROUP] for start in range(0, len(text), _GROUP)]
    return MARK + "-".join([*parts, _ALPHABET[_check(values)]])


def is_design_code(text: str) -> bool:
    """Whether a text is meant as a code: it begins with FF-, which no hex digits do."""
    return text.strip().upper().startswith(MARK)


def digits_of_code(code: str) -> str:
    """The first hex digits of the ids of designs that have a code.

    Args:
        code: of one to six groups, in upper or lower case; hyphens after the first may be left out.

    Returns:
        Five hex digits for each group.

    Raises:
        InputError: a character that codes do not have, another length, or a wrong check character.
    """
    body = code.strip().upper().removeprefix(MARK).translate(_MEANT)
    if unknown := next((character for character in body if character not in _ALPHABET), None):
        raise InputError(f"design code {code!r}: {unknown!r} is in no code; look at it again")
    groups, rest = divmod(len(body), _GROUP)
    if not is_design_code(code) or rest != 1 or not 1 <= groups <= _LONGEST:
        raise InputError(f"design code {code!r}: a code is FF-, groups of four characters and a check character")
    *values, check = [_ALPHABET.index(character) for character in body]
    if check != _check(values):
        raise InputError(f"design code {code!r}: its check character does not fit; look for a slip in it")
    number = 0
    for value in values:
        number = number << _BITS | value
    return f"{number:0{_HEX_GROUP * groups}x}"


def _check(values: list[int]) -> int:
    """The sum of x^(n - i) values[i] over the field of 32 elements."""
    total = 0
    for value in values:
        total = (total ^ value) << 1
        if total & _FIELD:
            total ^= _POLYNOMIAL
    return total
