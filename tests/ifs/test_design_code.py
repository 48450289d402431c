import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.errors import InputError
from fractal_farm.ifs.design_code import design_code, digits_of_code, is_design_code

IDS = st.integers(0, 2**128 - 1).map("{:032x}".format)
ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"


@given(IDS, st.integers(1, 6))
def test_a_code_of_any_length_gives_back_the_first_digits_of_its_id(identity, groups):
    code = design_code(identity, groups)
    assert is_design_code(code)
    assert digits_of_code(code) == identity[: 5 * groups]
    assert digits_of_code(code.lower().replace("-", "").replace("ff", "ff-", 1)) == identity[: 5 * groups]


def test_a_code_is_the_id_in_base_32_as_python_computes_it():
    identity = "f" * 4 + "0" * 4 + "12345678" * 3
    body = design_code(identity).removeprefix("FF-").replace("-", "")[:-1]
    python_digits = "0123456789ABCDEFGHIJKLMNOPQRSTUV"
    assert int(body.translate(str.maketrans(ALPHABET, python_digits)), 32) == int(identity[:15], 16)


def test_every_wrong_character_and_every_swap_is_found():
    identity = random.Random(7).randbytes(16).hex()
    code = design_code(identity)
    places = [place for place in range(3, len(code)) if code[place] != "-"]
    for place, character in itertools.product(places, ALPHABET):
        if character != code[place]:
            with pytest.raises(InputError, match="check character"):
                digits_of_code(code[:place] + character + code[place + 1 :])
    for one, other in itertools.combinations(places, 2):
        if code[one] != code[other]:
            swapped = list(code)
            swapped[one], swapped[other] = code[other], code[one]
            with pytest.raises(InputError, match="check character"):
                digits_of_code("".join(swapped))


def test_letters_that_look_like_digits_are_read_as_digits():
    code = next(c for k in range(999) if {"0", "1"} <= set(c := design_code(f"{k * 7919:015x}" + "0" * 17)))
    assert digits_of_code("FF-" + code[3:].replace("0", "O").replace("1", "I")) == digits_of_code(code)
    assert digits_of_code("ff-" + code[3:].replace("0", "o").replace("1", "l")) == digits_of_code(code)


@pytest.mark.parametrize("code", ["FF-", "FF-7Q2K", "FF-7Q2K-91", "FF-" + "0" * 29])
def test_another_length_is_refused(code):
    with pytest.raises(InputError, match=r"groups of four"):
        digits_of_code(code)


@pytest.mark.parametrize("code", ["FF-UUUU-U", "FF-7Q2\N{LATIN SMALL LETTER E WITH ACUTE}-0", "FF-7Q2*-0"])
def test_a_character_of_no_code_is_refused(code):
    with pytest.raises(InputError, match="in no code"):
        digits_of_code(code)
