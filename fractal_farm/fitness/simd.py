"""Explicit SIMD in numba: sixteen float32, or sixteen uint32, as one value.

Left to itself numba widens small integers to 64 bits, and the pair count runs five times slower than the hardware
allows. Here a vector is a numba type, and each operation is a few lines of LLVM IR, inlined where a kernel calls it
like any other function. LLVM lowers a vector to one AVX-512 register, two AVX2 or four NEON registers; all operations
are exact or correctly rounded, so that the results are the same bits on each.
"""

from __future__ import annotations

import functools
import platform
from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.registry import cpu_target
from numba.extending import intrinsic, models, register_model

LANES = 16
FRACTION_BITS = 23  # of a float32
EXPONENT_BIAS = 127
_WORD_BITS = 32
_CARRY = 0b11101000  # truth table of: at least two of three bits
_LOWEST_BITS = 0x01010101  # of four bytes
_EVEN_BYTES = 0x00FF00FF
_HALF_BITS = 16

_I1 = ir.IntType(1)
_I32 = ir.IntType(32)
_I64 = ir.IntType(64)
_FLOATS = ir.VectorType(ir.FloatType(), LANES)
_WORDS = ir.VectorType(_I32, LANES)


class FloatsType(types.Type):
    """Numba type of sixteen float32."""

    def __init__(self) -> None:
        super().__init__("simd.Floats")


class WordsType(types.Type):
    """Numba type of sixteen uint32."""

    def __init__(self) -> None:
        super().__init__("simd.Words")


@register_model(FloatsType)
class _FloatsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _FLOATS)  # type: ignore[no-untyped-call]


@register_model(WordsType)
class _WordsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _WORDS)  # type: ignore[no-untyped-call]


Floats = FloatsType()
Words = WordsType()
FloatPointer = types.CPointer(types.float32)
WordPointer = types.CPointer(types.uint32)
CountPointer = types.CPointer(types.int64)


def _operation(result: Any, *parameters: Any) -> Callable[[Callable[..., Any]], Any]:
    """A numba function of fixed types from one that emits LLVM IR: emit(builder, *values) -> value, tuple or None."""

    def decorate(emit: Callable[..., Any]) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            value = emit(builder, *arguments)
            if value is None:
                return context.get_dummy_value()
            if isinstance(value, tuple):
                return context.make_tuple(builder, signature.return_type, value)
            return value

        def definition(_typing_context: Any, *_arguments: Any) -> Any:
            return result(*parameters), generate

        functools.update_wrapper(definition, emit)  # numba reads the parameters from emit
        return intrinsic(definition)

    return decorate


def _constant(value: int) -> Any:
    return ir.Constant(_WORDS, [value] * LANES)


def _splat(builder: Any, value: Any, vector: Any) -> Any:
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(first, nothing, _constant(0))


def _call(builder: Any, name: str, result: Any, *arguments: Any) -> Any:
    """Call an LLVM intrinsic."""
    signature = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, signature, name), arguments)


def instruction_set() -> str:
    """What kernels are compiled for: "AVX-512", "AVX2", or the name of another machine."""
    _, processor, features = cpu_target.target_context.codegen().magic_tuple()
    if "+avx512f" in features or "avx512" in processor:
        return "AVX-512"
    return "AVX2" if platform.machine() in ("x86_64", "AMD64") else platform.machine()


def _has_ternary_logic() -> bool:
    """Whether any function of three bits is one instruction; LLVM does not find it for a carry by itself."""
    return instruction_set() == "AVX-512"


@intrinsic
def _pointer(_typing_context: Any, array: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), generate


pointer: Any = _pointer
"""pointer(array): the address of a C-contiguous array, to be indexed like a flat array, unchecked.

Numba counts the references to an array wherever it is passed on, with atomic operations; in the pair count that takes a
third of the time. Pointers are not counted: the caller keeps the array alive."""


@_operation(Floats, FloatPointer, types.intp)
def load_floats(builder: Any, memory: Any, index: Any) -> Any:
    """Sixteen consecutive float32 from memory[index] on."""
    value = builder.load(builder.bitcast(builder.gep(memory, [index]), _FLOATS.as_pointer()))
    value.align = 4
    return value


@_operation(Words, WordPointer, types.intp)
def load_words(builder: Any, memory: Any, index: Any) -> Any:
    """Sixteen consecutive uint32 from memory[index] on."""
    value = builder.load(builder.bitcast(builder.gep(memory, [index]), _WORDS.as_pointer()))
    value.align = 4
    return value


@_operation(types.void, WordPointer, types.intp, Words)
def store_words(builder: Any, memory: Any, index: Any, words: Any) -> None:
    """Write sixteen uint32 to memory[index] and the following."""
    builder.store(words, builder.bitcast(builder.gep(memory, [index]), _WORDS.as_pointer())).align = 4


@_operation(Floats, types.float32)
def splat(builder: Any, value: Any) -> Any:
    """One float32 in all lanes."""
    return _splat(builder, value, _FLOATS)


@_operation(Floats, Floats, Floats)
def subtract(builder: Any, a: Any, b: Any) -> Any:
    """Difference a - b in each lane."""
    return builder.fsub(a, b)


@_operation(Floats, Floats, Floats)
def maximum(builder: Any, a: Any, b: Any) -> Any:
    """The larger one in each lane."""
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


@_operation(Floats, Floats, Floats, Floats)
def squared_length(builder: Any, x: Any, y: Any, z: Any) -> Any:
    """Sum of squares by two fused multiply-adds, fma(x, x, fma(y, y, z z)): three roundings, each monotone."""
    inner = _call(builder, "llvm.fma.v16f32", _FLOATS, y, y, builder.fmul(z, z))
    return _call(builder, "llvm.fma.v16f32", _FLOATS, x, x, inner)


@_operation(Words, Floats, types.int32)
def octave(builder: Any, value: Any, lowest: Any) -> Any:
    """Biased binary exponent of lanes, floor(log2(value)) + 127, but at least `lowest`.

    Of infinity it is 255, and of what is not a number 255 or, with the sign, 511: both are 31 modulo 32.
    """
    exponent = builder.lshr(builder.bitcast(value, _WORDS), _constant(FRACTION_BITS))
    floor = _splat(builder, lowest, _WORDS)
    return builder.select(builder.icmp_unsigned(">", exponent, floor), exponent, floor)


@_operation(Words, Words)
def one_hot(builder: Any, position: Any) -> Any:
    """1 << (position mod 32) in each lane."""
    if _has_ternary_logic():  # and a rotation
        return _call(builder, "llvm.fshl.v16i32", _WORDS, _constant(1), _constant(1), position)
    return builder.shl(_constant(1), builder.and_(position, _constant(_WORD_BITS - 1)))


@_operation(Words)
def no_bits(_builder: Any) -> Any:
    """All bits zero."""
    return _constant(0)


@_operation(types.UniTuple(Words, 2), Words, Words, Words)
def full_adder(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """Sum and carry of three one-bit numbers, for all bits at once: a xor b xor c, and at least two of a, b, c."""
    either = builder.xor(a, b)
    if _has_ternary_logic():
        carry = _call(builder, "llvm.x86.avx512.pternlog.d.512", _WORDS, a, b, c, ir.Constant(_I32, _CARRY))
    else:
        carry = builder.or_(builder.and_(a, b), builder.and_(either, c))
    return builder.xor(either, c), carry


@_operation(Words, Words, Words, types.int32)
def add_bit(builder: Any, sums: Any, words: Any, bit: Any) -> Any:
    """Four byte counters a lane: sums + ((words >> bit) & 0x01010101), so that byte j counts bit (bit + 8 j)."""
    shifted = builder.lshr(words, _splat(builder, bit, _WORDS))
    return builder.add(sums, builder.and_(shifted, _constant(_LOWEST_BITS)))


@_operation(types.void, CountPointer, types.int64, Words, types.int64)
def add_bytes(builder: Any, counts: Any, bit: Any, sums: Any, worth: Any) -> None:
    """For each byte j of the lanes: counts[bit + 8 j] += worth x (the sum of that byte over the lanes)."""
    for odd in range(2):
        pairs_of_bytes = builder.and_(builder.lshr(sums, _constant(8 * odd)), _constant(_EVEN_BYTES))
        total = _call(builder, "llvm.vector.reduce.add.v16i32", _I32, pairs_of_bytes)
        low = builder.and_(total, ir.Constant(_I32, (1 << _HALF_BITS) - 1))
        high = builder.lshr(total, ir.Constant(_I32, _HALF_BITS))
        for byte, sum_of_byte in ((odd, low), (odd + 2, high)):
            address = builder.gep(counts, [builder.add(bit, ir.Constant(_I64, 8 * byte))])
            amount = builder.mul(worth, builder.zext(sum_of_byte, _I64))
            builder.store(builder.add(builder.load(address), amount), address)


@_operation(types.uint32, Words, types.int32)
def lanes_below(builder: Any, words: Any, limit: Any) -> Any:
    """Bit mask of the lanes with words < limit."""
    below = builder.icmp_unsigned("<", words, _splat(builder, limit, _WORDS))
    return builder.zext(builder.bitcast(below, ir.IntType(LANES)), _I32)


@_operation(types.uint32, Words, Words)
def lanes_equal(builder: Any, a: Any, b: Any) -> Any:
    """Bit mask of the lanes with a == b."""
    return builder.zext(builder.bitcast(builder.icmp_unsigned("==", a, b), ir.IntType(LANES)), _I32)


@_operation(Words, Words, Words, Words)
def where_equal(builder: Any, a: Any, b: Any, words: Any) -> Any:
    """The words in the lanes with a == b, zero elsewhere."""
    return builder.select(builder.icmp_unsigned("==", a, b), words, _constant(0))


@_operation(types.int64, types.uint32)
def trailing_zeros(builder: Any, word: Any) -> Any:
    """Number of zero bits below the lowest set bit; 32 for zero."""
    return builder.zext(_call(builder, "llvm.cttz.i32", _I32, word, ir.Constant(_I1, 0)), _I64)


@_operation(types.int64, types.uint32)
def leading_zeros(builder: Any, word: Any) -> Any:
    """Number of zero bits above the highest set bit; 32 for zero."""
    return builder.zext(_call(builder, "llvm.ctlz.i32", _I32, word, ir.Constant(_I1, 0)), _I64)
