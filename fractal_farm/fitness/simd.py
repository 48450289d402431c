"""Explicit SIMD in numba: sixteen float32, or sixteen uint32, as one value.

Left to itself numba widens small integers to 64 bits and vectorises the pair count five times slower than the
hardware allows. Here a vector is a numba type, and each operation below is a few lines of LLVM IR, inlined where it is
called. LLVM lowers a vector to one AVX-512 register, two AVX2 or four NEON registers; all operations are exact or
correctly rounded, so the results are the same bits on each.

`Floats` and `Words` are the two types; a kernel calls the functions as it would call any other.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, models, register_model

LANES = 16

_I1 = ir.IntType(1)
_I8 = ir.IntType(8)
_I32 = ir.IntType(32)
_I64 = ir.IntType(64)
_FLOATS = ir.VectorType(ir.FloatType(), LANES)
_WORDS = ir.VectorType(_I32, LANES)


class FloatsType(types.Type):  # type: ignore[misc]
    """Numba type of sixteen float32."""

    def __init__(self) -> None:
        super().__init__("simd.Floats")


class WordsType(types.Type):  # type: ignore[misc]
    """Numba type of sixteen uint32."""

    def __init__(self) -> None:
        super().__init__("simd.Words")


Floats = FloatsType()
Words = WordsType()


@register_model(FloatsType)
class _FloatsModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager, numba_type) -> None:
        super().__init__(manager, numba_type, _FLOATS)


@register_model(WordsType)
class _WordsModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager, numba_type) -> None:
        super().__init__(manager, numba_type, _WORDS)


def _words(value: int) -> ir.Constant:
    return ir.Constant(_WORDS, [value] * LANES)


def _call(builder, name, result, *arguments):
    """Call an LLVM intrinsic."""
    signature = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, signature, name), arguments)


def _has_ternary_logic(context) -> bool:
    """Whether any function of three bits is one instruction; LLVM does not find it for a carry by itself."""
    return "+avx512f" in getattr(context.codegen(), "_tm_features", "")


@intrinsic
def pointer(typing_context, array):
    """The address of a C-contiguous array's first element, to be indexed like a flat array, unchecked.

    Numba counts the references to an array wherever it is passed on, with atomic operations; in the pair count that
    takes a third of the time. Pointers are not counted: the caller keeps the array.
    """

    def generate(context, builder, signature, arguments):
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), generate


@intrinsic
def load(typing_context, memory, index):
    """Sixteen consecutive elements from `index`: Floats of a float32 pointer, Words of a uint32 pointer."""
    vector = Floats if memory.dtype == types.float32 else Words

    def generate(context, builder, signature, arguments):
        llvm_type = context.get_value_type(signature.return_type)
        value = builder.load(builder.bitcast(builder.gep(arguments[0], [arguments[1]]), llvm_type.as_pointer()))
        value.align = 4
        return value

    return vector(memory, types.intp), generate


@intrinsic
def store(typing_context, memory, index, words):
    """Write sixteen words from `index` of a uint32 pointer."""

    def generate(context, builder, signature, arguments):
        place = builder.bitcast(builder.gep(arguments[0], [arguments[1]]), _WORDS.as_pointer())
        builder.store(arguments[2], place).align = 4
        return context.get_dummy_value()

    return types.void(memory, types.intp, Words), generate


@intrinsic
def splat(typing_context, value):
    """One float32 in all lanes."""

    def generate(context, builder, signature, arguments):
        nothing = ir.Constant(_FLOATS, ir.Undefined)
        first = builder.insert_element(nothing, arguments[0], ir.Constant(_I32, 0))
        return builder.shuffle_vector(first, nothing, _words(0))

    return Floats(types.float32), generate


@intrinsic
def subtract(typing_context, a, b):
    """Difference a - b of each lane."""

    def generate(context, builder, signature, arguments):
        return builder.fsub(*arguments)

    return Floats(Floats, Floats), generate


@intrinsic
def maximum(typing_context, a, b):
    """The larger of each lane; `b` where they do not compare."""

    def generate(context, builder, signature, arguments):
        return builder.select(builder.fcmp_ordered(">", *arguments), *arguments)

    return Floats(Floats, Floats), generate


@intrinsic
def squared_length(typing_context, x, y, z):
    """x x + y y + z z with two fused multiply-adds: fma(x, x, fma(y, y, z z)), four roundings fewer than five."""

    def generate(context, builder, signature, arguments):
        x, y, z = arguments
        inner = _call(builder, "llvm.fma.v16f32", _FLOATS, y, y, builder.fmul(z, z))
        return _call(builder, "llvm.fma.v16f32", _FLOATS, x, x, inner)

    return Floats(Floats, Floats, Floats), generate


@intrinsic(prefer_literal=True)  # type: ignore[misc]
def octave(typing_context, value, lowest):
    """Biased binary exponent of non-negative lanes, at least `lowest` (a literal): floor(log2(value)) + 127."""

    def generate(context, builder, signature, arguments):
        exponent = builder.lshr(builder.bitcast(arguments[0], _WORDS), _words(23))
        floor = _words(lowest.literal_value)
        return builder.select(builder.icmp_unsigned(">", exponent, floor), exponent, floor)

    if not isinstance(lowest, types.IntegerLiteral):
        return None
    return Words(Floats, lowest), generate


@intrinsic
def one_hot(typing_context, position):
    """1 << (position mod 32) in each lane."""

    def generate(context, builder, signature, arguments):
        if _has_ternary_logic(context):
            return _call(builder, "llvm.fshl.v16i32", _WORDS, _words(1), _words(1), arguments[0])
        return builder.shl(_words(1), builder.and_(arguments[0], _words(31)))

    return Words(Words), generate


@intrinsic
def no_bits(typing_context):
    """All bits zero."""

    def generate(context, builder, signature, arguments):
        return _words(0)

    return Words(), generate


@intrinsic
def full_adder(typing_context, a, b, c):
    """(sum, carry) of three one-bit numbers, in all bits at once: a xor b xor c, and at least two of a, b, c."""

    def generate(context, builder, signature, arguments):
        a, b, c = arguments
        either = builder.xor(a, b)
        if _has_ternary_logic(context):
            table = ir.Constant(_I32, 0xE8)
            carry = _call(builder, "llvm.x86.avx512.pternlog.d.512", _WORDS, a, b, c, table)
        else:
            carry = builder.or_(builder.and_(a, b), builder.and_(either, c))
        return context.make_tuple(builder, signature.return_type, (builder.xor(either, c), carry))

    return types.UniTuple(Words, 2)(Words, Words, Words), generate


@intrinsic(prefer_literal=True)  # type: ignore[misc]
def add_bit(typing_context, sums, words, bit):
    """Four byte counters a lane: sums + ((words >> bit) & 0x01010101), so byte j counts bit (bit + 8 j)."""

    def generate(context, builder, signature, arguments):
        sums, words, _ = arguments
        shifted = builder.lshr(words, _words(bit.literal_value))
        return builder.add(sums, builder.and_(shifted, _words(0x01010101)))

    if not isinstance(bit, types.IntegerLiteral):
        return None
    return Words(Words, Words, bit), generate


@intrinsic
def add_bytes(typing_context, counts, bit, sums, weight):
    """For each byte j of the lanes: counts[bit + 8 j] += weight * (its sum over the lanes); int64 pointer."""

    def generate(context, builder, signature, arguments):
        counts, bit, sums, weight = arguments
        for parity_of_byte in range(2):
            halves = builder.and_(builder.lshr(sums, _words(8 * parity_of_byte)), _words(0x00FF00FF))
            total = _call(builder, "llvm.vector.reduce.add.v16i32", _I32, halves)
            low = builder.and_(total, ir.Constant(_I32, 0xFFFF))
            high = builder.lshr(total, ir.Constant(_I32, 16))
            for byte, value in ((parity_of_byte, low), (parity_of_byte + 2, high)):
                place = builder.add(bit, ir.Constant(bit.type, 8 * byte))
                address = builder.gep(counts, [place])
                amount = builder.mul(weight, builder.zext(value, _I64))
                builder.store(builder.add(builder.load(address), amount), address)
        return context.get_dummy_value()

    return types.void(counts, types.intp, Words, types.int64), generate


@intrinsic(prefer_literal=True)  # type: ignore[misc]
def lanes_below(typing_context, words, limit):
    """Bit mask (uint32) of the lanes with words < limit (a literal)."""

    def generate(context, builder, signature, arguments):
        below = builder.icmp_unsigned("<", arguments[0], _words(limit.literal_value))
        return builder.zext(builder.bitcast(below, ir.IntType(LANES)), _I32)

    if not isinstance(limit, types.IntegerLiteral):
        return None
    return types.uint32(Words, limit), generate


@intrinsic
def lanes_equal(typing_context, a, b):
    """Bit mask (uint32) of the lanes with a == b."""

    def generate(context, builder, signature, arguments):
        equal = builder.icmp_unsigned("==", *arguments)
        return builder.zext(builder.bitcast(equal, ir.IntType(LANES)), _I32)

    return types.uint32(Words, Words), generate


@intrinsic
def trailing_zeros(typing_context, word):
    """Number of zero bits below the lowest set bit of a uint32 (32 for zero)."""

    def generate(context, builder, signature, arguments):
        return builder.zext(_call(builder, "llvm.cttz.i32", _I32, arguments[0], ir.Constant(_I1, 0)), _I64)

    return types.int64(types.uint32), generate


@intrinsic
def leading_zeros(typing_context, word):
    """Number of zero bits above the highest set bit of a uint32 (32 for zero)."""

    def generate(context, builder, signature, arguments):
        return builder.zext(_call(builder, "llvm.ctlz.i32", _I32, arguments[0], ir.Constant(_I1, 0)), _I64)

    return types.int64(types.uint32), generate


@intrinsic
def where_equal(typing_context, a, b, words):
    """`words` in the lanes with a == b, zero elsewhere."""

    def generate(context, builder, signature, arguments):
        a, b, words = arguments
        return builder.select(builder.icmp_unsigned("==", a, b), words, _words(0))

    return Words(Words, Words, Words), generate
