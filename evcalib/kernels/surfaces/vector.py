"""Patch updates as LLVM vectors: one patch row, one load, a few instructions, one store.

Written as LLVM IR because a loop over 7 or 13 pixels is too short for the automatic vectoriser.
Any CPU that LLVM knows can run it: vectors wider than its registers are split.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def lanes(size: int) -> int:
    """Return the vector length for a patch row: the next power of two."""
    return 1 << (size - 1).bit_length()


def _rows(context, builder, signature, args, size):
    """Return element type, vector type, the patch mask and pointers to the rows of the patch."""
    array, start, stride = args[0], args[1], args[2]
    data = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=array).data
    item = context.get_data_type(signature.args[0].dtype)
    vector = ir.VectorType(item, lanes(size))
    one = ir.Constant(vector, [1] * size + [0] * (vector.count - size))
    pointers = []
    for _ in range(size):
        place = builder.gep(data, [start])
        pointers.append((place, builder.bitcast(place, vector.as_pointer())))
        start = builder.add(start, stride)
    return item, vector, one, pointers


def _splat(builder, vector, scalar):
    first = builder.insert_element(
        ir.Constant(vector, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
    )
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)


@intrinsic(prefer_literal=True)
def tos_patch(typingctx, surface, start, stride, threshold, size):
    """Apply one event of the TOS to the patch whose first pixel is surface[start].

    v - 1 < threshold gives 0, else v - 1; then centre = 255.  `surface` is flat; `size`, the side
    of the patch, is a constant.  Reads, but does not change, `lanes(size) - size` pixels more.
    """
    if not isinstance(size, types.IntegerLiteral):
        return None
    side = size.literal_value

    def codegen(context, builder, signature, args):
        item, vector, one, pointers = _rows(context, builder, signature, args, side)
        # Pixels beyond the patch hold 0 or at least the threshold: minus 0, they stay.
        limit = builder.add(_splat(builder, vector, builder.trunc(args[3], item)), one)
        zero = ir.Constant(vector, None)
        for _, pointer in pointers:
            row = builder.load(pointer, align=1)
            keep = builder.icmp_unsigned(">=", row, limit)
            builder.store(builder.select(keep, builder.sub(row, one), zero), pointer, align=1)
        centre = builder.gep(pointers[side // 2][0], [ir.Constant(args[1].type, side // 2)])
        builder.store(ir.Constant(item, 255), centre)
        return context.get_dummy_value()

    return types.void(surface, types.intp, types.intp, types.intp, size), codegen


@intrinsic(prefer_literal=True)
def silc_patch(typingctx, surface, start, stride, size):
    """Apply one event of the SILC surface to the patch whose first pixel is surface[start].

    v >= max(centre, 1) gives v - 1; then centre = size * size.  The rest as in `tos_patch`.
    """
    if not isinstance(size, types.IntegerLiteral):
        return None
    side = size.literal_value

    def codegen(context, builder, signature, args):
        item, vector, one, pointers = _rows(context, builder, signature, args, side)
        place = builder.gep(pointers[side // 2][0], [ir.Constant(args[1].type, side // 2)])
        centre = builder.load(place)
        least = ir.Constant(item, 1)
        centre = builder.select(builder.icmp_unsigned(">", centre, least), centre, least)
        limit = _splat(builder, vector, centre)
        zero = ir.Constant(vector, None)
        for _, pointer in pointers:
            row = builder.load(pointer, align=1)
            step = builder.select(builder.icmp_unsigned(">=", row, limit), one, zero)
            builder.store(builder.sub(row, step), pointer, align=1)
        builder.store(ir.Constant(item, side * side), place)
        return context.get_dummy_value()

    return types.void(surface, types.intp, types.intp, size), codegen


@intrinsic
def as_float(typingctx, bits):
    """Return the float64 with the given 64 bits."""

    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), codegen


@intrinsic
def as_bits(typingctx, value):
    """Return the 64 bits of a float64."""

    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), codegen
