"""Sums over a patch as LLVM vectors: four columns or eight at a time, all rows in registers.

Written as LLVM IR for the same reason as `evcalib.kernels.surfaces.vector`: a loop over 15 columns
is too short for the automatic vectoriser.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_FLOAT = ir.FloatType()
_WIDEST = 8


def blocks(side: int) -> tuple[int, list[tuple[int, int]]]:
    """Return the vector length for a row of `side` columns, and the vectors that cover it.

    Each as its first column, and the first of its columns that the one before does not hold: the
    last vector reaches back over it rather than out of the patch, as that may leave the image.
    """
    length = min(_WIDEST, 1 << (side.bit_length() - 1))
    starts = [*range(0, side - length, length), side - length]
    return length, [(start, k * length) for k, start in enumerate(starts)]


def _splat(builder, vector, scalar):
    one = builder.insert_element(
        ir.Constant(vector, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
    )
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)


def _row(builder, vector, data, place):
    pointer = builder.bitcast(builder.gep(data, [place]), vector.as_pointer())
    return builder.load(pointer, align=4)


@intrinsic(prefer_literal=True)
def compare_sums(typingctx, patch, image, start, stride, weights, side):
    """Return sums over a patch of value v, gx v, gy v and v v; v is an image between its pixels.

    Each column is summed down, then the columns one after the other, all as float32.

    Parameters
    ----------
    patch : ndarray of float32, shape (3, side, side)
        Values and slopes, contiguous.
    image : ndarray of float32, shape (height, width)
        Contiguous.
    start, stride : int
        Flat index of the pixel at the upper left of the first column and row, and the width.
    weights : tuple of four float32
        Of that pixel, its right, its lower and its lower right neighbour.
    side : int
        A constant.
    """
    if not isinstance(side, types.IntegerLiteral):
        return None
    n = side.literal_value

    def codegen(context, builder, signature, args):
        patch_data, image_data = (
            context.make_array(kind)(context, builder, value=value).data
            for kind, value in zip(signature.args[:2], args[:2], strict=True)
        )
        size = args[2].type
        length, covering = blocks(n)
        vector = ir.VectorType(_FLOAT, length)
        weight = [_splat(builder, vector, w) for w in cgutils.unpack_tuple(builder, args[4], 4)]
        totals = [ir.Constant(_FLOAT, 0.0)] * 4
        for first, fresh in covering:
            place = builder.add(args[2], ir.Constant(size, first))
            sums = [ir.Constant(vector, None)] * 4
            lower = None
            for row in range(n + 1):
                right = builder.add(place, ir.Constant(size, 1))
                upper, lower = lower, [_row(builder, vector, image_data, k) for k in (place, right)]
                place = builder.add(place, args[3])
                if upper is None:
                    continue
                v = builder.fmul(weight[0], upper[0])
                for w, pixels in zip(weight[1:], (upper[1], *lower), strict=True):
                    v = builder.fadd(v, builder.fmul(w, pixels))
                for k in range(4):
                    at = ir.Constant(size, (k * n + row - 1) * n + first)
                    factor = v if k == 3 else _row(builder, vector, patch_data, at)
                    sums[k] = builder.fadd(sums[k], builder.fmul(factor, v))
            for column in range(fresh - first, length):
                lane = ir.Constant(ir.IntType(32), column)
                totals = [
                    builder.fadd(total, builder.extract_element(part, lane))
                    for total, part in zip(totals, sums, strict=True)
                ]
        return context.make_tuple(builder, signature.return_type, totals)

    returned = types.UniTuple(types.float32, 4)
    return returned(patch, image, types.intp, types.intp, weights, side), codegen
