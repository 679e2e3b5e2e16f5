# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
"""Functions of SymAware on arrays of floating-point numbers, compiled, that return the same bits.

Each has the name of the function in SymAware that it takes the place of, which states what it computes; arguments that
are not arrays of doubles of matching shapes are handed on to that function. Sums, products, quotients and square roots
are rounded alike everywhere. Sines and the like are not: they are NumPy's own, called without making an array of each.
"""

cimport numpy as np
from libc.math cimport sqrt
from libc.stdint cimport uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy, memset

import sys

import numpy

np.import_array()
np.import_ufunc()

EDITION = 1
"""Which edition of the functions of SymAware these are; another one is not used."""

ctypedef void (*_Loop)(char **, np.npy_intp *, np.npy_intp *, void *) noexcept


cdef struct _Function:
    _Loop loop
    void *data


cdef _Function _function(object function) except *:
    """Find the loop of a function of NumPy on doubles, as NumPy chose it for this processor."""
    cdef _Function found
    cdef int number
    signature = "d" * function.nin + "->" + "d" * function.nout
    if signature not in function.types:
        raise ImportError(f"this NumPy has no loop on doubles for {function}")
    number = function.types.index(signature)
    found.loop = <_Loop>(<np.ufunc>function).functions[number]
    found.data = (<void **>(<np.ufunc>function).data)[number]
    if found.loop == NULL:
        raise ImportError(f"this NumPy has no loop on doubles for {function}")
    return found


cdef _Function _SIN = _function(numpy.sin)
cdef _Function _COS = _function(numpy.cos)
cdef _Function _ARCTAN2 = _function(numpy.arctan2)
cdef _Function _REMAINDER = _function(numpy.remainder)
cdef _Function _LOG = _function(numpy.log)

cdef double _HALF_TURN = numpy.pi
cdef double _TURN = 2 * numpy.pi

cdef dict _references = {}


def replaced(reference):
    """Return the function that takes the place of one of SymAware, by its name; the same one if there is none."""
    compiled = _COMPILED.get(reference.__name__)
    if compiled is None:
        return reference
    _references[reference.__name__] = reference
    return compiled


# --- arrays -----------------------------------------------------------------------------------------------------------


cdef struct _Rows:
    char *data
    np.npy_intp count
    np.npy_intp width
    np.npy_intp down
    np.npy_intp along


cdef inline bint _rows(object values, _Rows *rows, int dimensions=2):
    """Describe an array of doubles (n, k) with any strides, or (n,) as one column; false if it is none."""
    if not np.PyArray_Check(values) or np.PyArray_NDIM(<np.ndarray>values) != dimensions:
        return False
    cdef np.ndarray array = values
    if np.PyArray_TYPE(array) != np.NPY_DOUBLE or not np.PyArray_ISBEHAVED_RO(array):
        return False
    rows.data = <char *>np.PyArray_DATA(array)
    rows.count, rows.down = np.PyArray_DIM(array, 0), np.PyArray_STRIDE(array, 0)
    rows.width, rows.along = 1, 0
    if dimensions == 2:
        rows.width, rows.along = np.PyArray_DIM(array, 1), np.PyArray_STRIDE(array, 1)
    return True


cdef inline bint _indices(object values, int dimensions):
    """Whether it is a contiguous array of indices."""
    return (
        np.PyArray_Check(values)
        and np.PyArray_NDIM(<np.ndarray>values) == dimensions
        and np.PyArray_TYPE(<np.ndarray>values) == np.NPY_INTP
        and np.PyArray_IS_C_CONTIGUOUS(<np.ndarray>values)
    )


cdef inline double _at(_Rows *rows, np.npy_intp row, np.npy_intp column) noexcept:
    return (<double *>(rows.data + row * rows.down + column * rows.along))[0]


cdef inline np.ndarray _vector(np.npy_intp count):
    return np.PyArray_EMPTY(1, &count, np.NPY_DOUBLE, 0)


cdef inline np.ndarray _matrix(np.npy_intp count, np.npy_intp width):
    cdef np.npy_intp shape[2]
    shape[0], shape[1] = count, width
    return np.PyArray_EMPTY(2, shape, np.NPY_DOUBLE, 0)


cdef inline double *_data(np.ndarray array) noexcept:
    return <double *>np.PyArray_DATA(array)


# --- numbers ----------------------------------------------------------------------------------------------------------
# Of two zeros NumPy's extrema are the second one, and with a NaN they are one.


cdef inline double _lesser(double one, double other) noexcept:
    return one if one < other or one != one else other


cdef inline double _greater(double one, double other) noexcept:
    return one if one > other or one != one else other


cdef inline void _of_one(_Function function, double *values, double *results, np.npy_intp count) noexcept:
    cdef char *arguments[2]
    cdef np.npy_intp steps[2]
    arguments[0], arguments[1] = <char *>values, <char *>results
    steps[0] = steps[1] = sizeof(double)
    function.loop(arguments, &count, steps, function.data)


cdef inline void _of_two(
    _Function function, double *values, double *others, np.npy_intp step, double *results, np.npy_intp count
) noexcept:
    cdef char *arguments[3]
    cdef np.npy_intp steps[3]
    arguments[0], arguments[1], arguments[2] = <char *>values, <char *>others, <char *>results
    steps[0], steps[1], steps[2] = sizeof(double), step, sizeof(double)
    function.loop(arguments, &count, steps, function.data)


# --- vectors and pairs ------------------------------------------------------------------------------------------------


def lengths(vectors):
    cdef _Rows of
    if not _rows(vectors, &of) or of.width == 0:
        return _references["lengths"](vectors)
    cdef np.npy_intp row, axis
    cdef np.ndarray result = _vector(of.count)
    cdef double *to = _data(result)
    cdef double value, total
    for row in range(of.count):
        value = _at(&of, row, 0)
        total = value * value
        for axis in range(1, of.width):
            value = _at(&of, row, axis)
            total = total + value * value
        to[row] = sqrt(total)
    return result


def pair_distances(positions, first, second):
    cdef _Rows of
    if not (_rows(positions, &of) and of.width and _indices(first, 1) and _indices(second, 1)):
        return _references["pair_distances"](positions, first, second)
    cdef np.npy_intp count = np.PyArray_DIM(<np.ndarray>first, 0), pair, axis
    cdef np.npy_intp *ones = <np.npy_intp *>np.PyArray_DATA(<np.ndarray>first)
    cdef np.npy_intp *others = <np.npy_intp *>np.PyArray_DATA(<np.ndarray>second)
    if np.PyArray_DIM(<np.ndarray>second, 0) != count:
        raise ValueError("pairs need as many second bodies as first ones")
    cdef np.ndarray result = _vector(count)
    cdef double *to = _data(result)
    cdef double apart, total
    for pair in range(count):
        if not (0 <= ones[pair] < of.count and 0 <= others[pair] < of.count):
            raise IndexError("a pair has a body that does not exist")
        apart = _at(&of, ones[pair], 0) - _at(&of, others[pair], 0)
        total = apart * apart
        for axis in range(1, of.width):
            apart = _at(&of, ones[pair], axis) - _at(&of, others[pair], axis)
            total = total + apart * apart
        to[pair] = sqrt(total)
    return result


def block_distances(positions, blocks):
    cdef _Rows of
    if not (_rows(positions, &of) and of.width and _indices(blocks, 2)):
        return _references["block_distances"](positions, blocks)
    cdef np.npy_intp places = np.PyArray_DIM(<np.ndarray>blocks, 0), runs = np.PyArray_DIM(<np.ndarray>blocks, 1)
    cdef np.npy_intp *bodies = <np.npy_intp *>np.PyArray_DATA(<np.ndarray>blocks)
    cdef np.npy_intp place, other, run, axis
    for place in range(places * runs):
        if not 0 <= bodies[place] < of.count:
            raise IndexError("a block has a body that does not exist")
    # The coordinates of each axis by place and run, so that the loops over runs are contiguous.
    cdef np.ndarray gathered = _matrix(of.width, places * runs)
    cdef double *values = _data(gathered)
    for place in range(places * runs):
        for axis in range(of.width):
            values[axis * places * runs + place] = _at(&of, bodies[place], axis)
    cdef np.ndarray result = _vector(places * (places - 1) // 2 * runs)
    cdef double *to = _data(result)
    cdef double *ones
    cdef double *others
    cdef double apart
    for place in range(places):
        for other in range(place + 1, places):
            ones, others = values + place * runs, values + other * runs
            for run in range(runs):
                apart = ones[run] - others[run]
                to[run] = apart * apart
            for axis in range(1, of.width):
                ones, others = ones + places * runs, others + places * runs
                for run in range(runs):
                    apart = ones[run] - others[run]
                    to[run] = to[run] + apart * apart
            for run in range(runs):
                to[run] = sqrt(to[run])
            to += runs
    return result


# --- control and motion -----------------------------------------------------------------------------------------------


def saturated(control_input, low, high):
    cdef _Rows of, least, most
    if not (_rows(control_input, &of) and _rows(low, &least) and _rows(high, &most)):
        return _references["saturated"](control_input, low, high)
    if not (of.count == least.count == most.count and of.width == least.width == most.width):
        return _references["saturated"](control_input, low, high)
    cdef np.npy_intp row, column
    cdef np.ndarray result = _matrix(of.count, of.width)
    cdef double *to = _data(result)
    for row in range(of.count):
        for column in range(of.width):
            to[row * of.width + column] = _lesser(
                _greater(_at(&of, row, column), _at(&least, row, column)), _at(&most, row, column)
            )
    return result


def approach(goal, position, speed, gain):
    cdef _Rows of, at
    if not (_rows(goal, &of) and _rows(position, &at) and isinstance(speed, float) and isinstance(gain, float)):
        return _references["approach"](goal, position, speed, gain)
    if not of.width or of.count != at.count or of.width != at.width:
        return _references["approach"](goal, position, speed, gain)
    cdef np.npy_intp row, axis, width = of.width
    cdef np.ndarray distances = _vector(of.count), speeds = _vector(of.count)
    cdef np.ndarray directions = _matrix(of.count, width), velocities = _matrix(of.count, width)
    cdef double *distance = _data(distances)
    cdef double *slow = _data(speeds)
    cdef double *direction = _data(directions)
    cdef double *velocity = _data(velocities)
    cdef double cruise = speed, slope = gain, way, total, factor
    for row in range(of.count):
        total = 0.0
        for axis in range(width):
            way = _at(&of, row, axis) - _at(&at, row, axis)
            direction[row * width + axis] = way
            total = total + way * way if axis else way * way
        distance[row] = sqrt(total)
        slow[row] = _lesser(cruise, slope * distance[row])
        factor = 1.0 / _greater(distance[row], 1e-12)
        for axis in range(row * width, (row + 1) * width):
            direction[axis] = direction[axis] * factor
            velocity[axis] = direction[axis] * slow[row]
    return distances, speeds, directions, velocities


def aimed(state, velocity, Py_ssize_t heading):
    cdef _Rows of, towards
    if not (_rows(state, &of) and _rows(velocity, &towards)):
        return _references["aimed"](state, velocity, heading)
    if of.count != towards.count or towards.width < 2 or not 0 <= heading < of.width:
        return _references["aimed"](state, velocity, heading)
    cdef np.npy_intp row, count = of.count
    cdef np.ndarray speeds = _vector(count), errors = _vector(count), scratch = _vector(2 * count)
    cdef double *speed = _data(speeds)
    cdef double *error = _data(errors)
    cdef double *x = _data(scratch)
    cdef double *y = x + count
    for row in range(count):
        x[row], y[row] = _at(&towards, row, 0), _at(&towards, row, 1)
        speed[row] = sqrt(x[row] * x[row] + y[row] * y[row])
    _of_two(_ARCTAN2, y, x, sizeof(double), error, count)
    for row in range(count):
        x[row] = error[row] - _at(&of, row, heading) + _HALF_TURN
    _of_two(_REMAINDER, x, &_TURN, 0, y, count)
    for row in range(count):
        error[row] = y[row] - _HALF_TURN if speed[row] > 1e-9 else 0.0
    return speeds, errors


def steered(speed, error, gain):
    cdef _Rows of, off
    if not (_rows(speed, &of, 1) and _rows(error, &off, 1) and isinstance(gain, float) and of.count == off.count):
        return _references["steered"](speed, error, gain)
    cdef np.npy_intp row, count = of.count
    cdef np.ndarray result = _matrix(count, 2), scratch = _vector(2 * count)
    cdef double *to = _data(result)
    cdef double *angle = _data(scratch)
    cdef double *cosine = angle + count
    cdef double slope = gain
    for row in range(count):
        angle[row] = _at(&off, row, 0)
    _of_one(_COS, angle, cosine, count)
    for row in range(count):
        to[2 * row] = _at(&of, row, 0) * _greater(cosine[row], 0.0)
        to[2 * row + 1] = angle[row] * slope
    return result


def arc_ends(state, control_input, step):
    cdef _Rows of, given
    if not (_rows(state, &of) and _rows(control_input, &given) and isinstance(step, float)):
        return _references["arc_ends"](state, control_input, step)
    if of.count != given.count or of.width != 3 or given.width != 2:
        return _references["arc_ends"](state, control_input, step)
    cdef np.npy_intp row, count = of.count
    cdef np.ndarray result = _matrix(count, 3), scratch = _vector(5 * count)
    cdef double *to = _data(result)
    cdef double *half = _data(scratch)
    cdef double *towards = half + count
    cdef double *sine = towards + count
    cdef double *cosine = sine + count
    cdef double *chord = cosine + count
    cdef double time = step
    for row in range(count):
        half[row] = 0.5 * time * _at(&given, row, 1)
        towards[row] = _at(&of, row, 2) + half[row]
        if half[row] == 0.0:
            half[row] = half[row] + 1e-300
    _of_one(_SIN, half, sine, count)
    for row in range(count):
        chord[row] = time * _at(&given, row, 0) * (sine[row] / half[row])
    _of_one(_COS, towards, cosine, count)
    _of_one(_SIN, towards, sine, count)
    for row in range(count):
        to[3 * row] = _at(&of, row, 0) + chord[row] * cosine[row]
        to[3 * row + 1] = _at(&of, row, 1) + chord[row] * sine[row]
        to[3 * row + 2] = _at(&of, row, 2) + time * _at(&given, row, 1)
    return result


# --- draws ------------------------------------------------------------------------------------------------------------

cdef int _BLOCK = 2048
cdef double _OF_32 = 2.0**-32
cdef double _ANGLE = 2.0 * numpy.pi * 2.0**-32


cdef inline void _scramble(uint32_t *words, uint32_t low, uint32_t high) noexcept:
    """Scramble a counter of four words with a key of two, by Philox-4x32-10."""
    cdef int number
    cdef uint64_t one, other
    for number in range(10):
        one = words[0] * <uint64_t>0xD2511F53
        other = words[2] * <uint64_t>0xCD9E8D57
        words[0] = <uint32_t>(other >> 32) ^ words[1] ^ low
        words[2] = <uint32_t>(one >> 32) ^ words[3] ^ high
        words[1], words[3] = <uint32_t>other, <uint32_t>one
        low += <uint32_t>0x9E3779B9
        high += <uint32_t>0xBB67AE85


cdef inline bint _numbers(object values, np.npy_intp count):
    """Whether it is a contiguous array of numbers of 64 bits without signs."""
    return (
        np.PyArray_Check(values)
        and np.PyArray_NDIM(<np.ndarray>values) == 1
        and np.PyArray_DIM(<np.ndarray>values, 0) == count
        and np.PyArray_TYPE(<np.ndarray>values) == np.NPY_UINT64
        and np.PyArray_IS_C_CONTIGUOUS(<np.ndarray>values)
        and np.PyArray_ISNOTSWAPPED(<np.ndarray>values)
    )


def normals(first, second, key, int width):
    cdef np.npy_intp count = len(first), begin, row, part
    cdef bint is_shared = isinstance(key, int)
    if not (1 <= width <= 4 and _numbers(first, count) and _numbers(second, count)):
        return _references["normals"](first, second, key, width)
    if not is_shared and not _numbers(key, count):
        return _references["normals"](first, second, key, width)
    cdef uint64_t *ones = <uint64_t *>np.PyArray_DATA(<np.ndarray>first)
    cdef uint64_t *others = <uint64_t *>np.PyArray_DATA(<np.ndarray>second)
    cdef uint64_t *keys = NULL
    cdef uint64_t own = 0
    if is_shared:
        own = key
    else:
        keys = <uint64_t *>np.PyArray_DATA(<np.ndarray>key)
    cdef int lanes = (width + 1) // 2, pairs = width // 2, lane
    cdef np.npy_intp block = min(count, _BLOCK)
    cdef np.ndarray result = _matrix(count, width), scratch = _vector(3 * lanes * block)
    cdef double *to = _data(result)
    cdef double *radius = _data(scratch)
    cdef double *angle = radius + lanes * block
    cdef double *wave = angle + lanes * block
    cdef uint32_t words[4]
    for begin in range(0, count, _BLOCK):
        part = min(count - begin, _BLOCK)
        for row in range(part):
            words[0], words[1] = <uint32_t>ones[begin + row], <uint32_t>(ones[begin + row] >> 32)
            words[2], words[3] = <uint32_t>others[begin + row], <uint32_t>(others[begin + row] >> 32)
            if keys != NULL:
                own = keys[begin + row]
            _scramble(words, <uint32_t>own, <uint32_t>(own >> 32))
            for lane in range(lanes):
                radius[lane * part + row] = (words[2 * lane] + 0.5) * _OF_32
                angle[lane * part + row] = words[2 * lane + 1] * _ANGLE
        _of_one(_LOG, radius, radius, lanes * part)
        for row in range(lanes * part):
            radius[row] = sqrt(radius[row] * -2.0)
        if pairs:
            _of_one(_SIN, angle, wave, pairs * part)
            for lane in range(pairs):
                for row in range(part):
                    to[(begin + row) * width + 2 * lane + 1] = radius[lane * part + row] * wave[lane * part + row]
        _of_one(_COS, angle, wave, lanes * part)
        for lane in range(lanes):
            for row in range(part):
                to[(begin + row) * width + 2 * lane] = radius[lane * part + row] * wave[lane * part + row]
    return result


# BLAKE2b: M.-J. Saarinen, J.-P. Aumasson, "The BLAKE2 Cryptographic Hash and Message Authentication Code", RFC 7693, 2015.

cdef uint64_t[8] _BEGIN = [
    0x6A09E667F3BCC908, 0xBB67AE8584CAA73B, 0x3C6EF372FE94F82B, 0xA54FF53A5F1D36F1,
    0x510E527FADE682D1, 0x9B05688C2B3E6C1F, 0x1F83D9ABFB41BD6B, 0x5BE0CD19137E2179,
]
cdef uint8_t[10][16] _ORDER = [
    [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15],
    [14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3],
    [11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4],
    [7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8],
    [9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13],
    [2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9],
    [12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11],
    [13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10],
    [6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5],
    [10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0],
]


cdef inline uint64_t _turned(uint64_t word, int bits) noexcept:
    return (word >> bits) | (word << (64 - bits))


cdef inline void _mix(uint64_t *v, int a, int b, int c, int d, uint64_t one, uint64_t other) noexcept:
    v[a] = v[a] + v[b] + one
    v[d] = _turned(v[d] ^ v[a], 32)
    v[c] = v[c] + v[d]
    v[b] = _turned(v[b] ^ v[c], 24)
    v[a] = v[a] + v[b] + other
    v[d] = _turned(v[d] ^ v[a], 16)
    v[c] = v[c] + v[d]
    v[b] = _turned(v[b] ^ v[c], 63)


cdef uint64_t _digest(uint8_t *text, uint64_t size) noexcept:
    """Return the digest of 8 bytes of a text of at most 128 bytes, which is one block."""
    cdef uint64_t v[16]
    cdef uint64_t m[16]
    cdef uint8_t *order
    cdef int number
    memset(m, 0, 128)
    memcpy(m, text, size)
    for number in range(8):
        v[number] = v[number + 8] = _BEGIN[number]
    v[0] ^= 0x01010008  # neither a key nor a tree, and 8 bytes
    v[12] ^= size
    v[14] = ~v[14]  # the last block
    for number in range(12):
        order = _ORDER[number % 10]
        _mix(v, 0, 4, 8, 12, m[order[0]], m[order[1]])
        _mix(v, 1, 5, 9, 13, m[order[2]], m[order[3]])
        _mix(v, 2, 6, 10, 14, m[order[4]], m[order[5]])
        _mix(v, 3, 7, 11, 15, m[order[6]], m[order[7]])
        _mix(v, 0, 5, 10, 15, m[order[8]], m[order[9]])
        _mix(v, 1, 6, 11, 12, m[order[10]], m[order[11]])
        _mix(v, 2, 7, 8, 13, m[order[12]], m[order[13]])
        _mix(v, 3, 4, 9, 14, m[order[14]], m[order[15]])
    return _BEGIN[0] ^ <uint64_t>0x01010008 ^ v[0] ^ v[8]


def digests(beginnings, bytes end):
    if sys.byteorder != "little" or not isinstance(beginnings, list):
        return _references["digests"](beginnings, end)
    cdef list texts = beginnings
    cdef Py_ssize_t row, count = len(texts), size, rest = len(end)
    cdef np.npy_intp shape = count
    cdef np.ndarray result = np.PyArray_EMPTY(1, &shape, np.NPY_UINT64, 0)
    cdef uint64_t *to = <uint64_t *>np.PyArray_DATA(result)
    cdef uint8_t block[128]
    cdef bytes text
    for row in range(count):
        text = texts[row]
        size = len(text)
        if size + rest > 128:
            return _references["digests"](beginnings, end)
        memcpy(block, <char *>text, size)
        memcpy(block + size, <char *>end, rest)
        to[row] = _digest(block, size + rest)
    return result


cdef dict _COMPILED = {
    each.__name__: each
    for each in (
        lengths, pair_distances, block_distances, saturated, approach, aimed, steered, arc_ends, normals, digests
    )
}
