"""The median, by quickselect: compiled in a fraction of the time that `np.median` takes."""

from evcalib.kernels.jit import jit


@jit
def _select(values, rank):
    """Bring the value of a rank to its place, smaller ones before it (Hoare's Find, 1961)."""
    low, high = 0, values.size - 1
    while low < high:
        pivot = values[rank]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if j < rank:
            low = i
        if i > rank:
            high = j
    return values[rank]


@jit
def median(values):
    """Return the median of one value or more, none of them NaN; they change places."""
    half = values.size // 2
    upper = _select(values, half)
    if values.size % 2 == 1:
        return upper
    lower = values[0]
    for i in range(1, half):
        lower = max(lower, values[i])
    return 0.5 * (lower + upper)
