"""Compiled loops over the edges of a sheaf: assembly of its matrices, and products without any matrix.

An `EdgeTable` t (edges.py) is walked edge by edge or vertex by vertex, in one order, by one thread: the same bits
everywhere. Its arrays are taken out of it before a loop, as each reading from the tuple costs. The Laplacian here is
delta^T delta; an inner product enters through whitened maps.
"""

import numpy as np

from mjsheaf.jit import allocating_jit, jit


@allocating_jit
def incidence(tail, head, vertices):
    """The edges at each vertex, ascending: (first (V + 1,), incident (2 E,))."""
    first = np.zeros(vertices + 1, dtype=np.int64)
    for e in range(len(tail)):
        first[tail[e] + 1] += 1
        first[head[e] + 1] += 1
    for v in range(vertices):
        first[v + 1] += first[v]
    place = first[:-1].copy()
    incident = np.empty(2 * len(tail), dtype=np.int64)
    for e in range(len(tail)):
        for v in (tail[e], head[e]):
            incident[place[v]] = e
            place[v] += 1
    return first, incident


@jit
def row_lengths(t, indptr):
    """Fill the row pointers of delta, shape (m + 1,)."""
    column, tail, head, row, size = t.column, t.tail, t.head, t.row, t.size
    indptr[:] = 0
    for e in range(len(tail)):
        i, j = tail[e], head[e]
        width = column[i + 1] - column[i] + column[j + 1] - column[j]
        for a in range(size[e]):
            indptr[row[e] + a + 1] = width
    for a in range(len(indptr) - 1):
        indptr[a + 1] += indptr[a]


@jit
def fill_coboundary(t, indptr, indices, values):
    """Fill delta: row F_tail x_tail - F_head x_head for each edge, columns ascending."""
    column, tail, head, row, size = t.column, t.tail, t.head, t.row, t.size
    F, at_tail, at_head = t.F, t.at_tail, t.at_head
    for e in range(len(tail)):
        for end in range(2):
            v, other = (tail[e], head[e]) if end == 0 else (head[e], tail[e])
            at = at_tail[e] if end == 0 else at_head[e]
            sign = 1.0 if end == 0 else -1.0
            n = column[v + 1] - column[v]
            skip = 0 if v < other else column[other + 1] - column[other]
            for a in range(size[e]):
                place = indptr[row[e] + a] + skip
                for k in range(n):
                    indices[place + k] = column[v] + k
                    values[place + k] = sign * F[at + a * n + k]


@jit
def coboundary_times(t, x, y):
    """Y = delta x; x of shape (n, k), y of shape (m, k)."""
    column, tail, head, row, size = t.column, t.tail, t.head, t.row, t.size
    F, at_tail, at_head = t.F, t.at_tail, t.at_head
    for e in range(len(tail)):
        i, j = tail[e], head[e]
        left, right = column[i], column[j]
        n_i, n_j = column[i + 1] - left, column[j + 1] - right
        for a in range(size[e]):
            for c in range(x.shape[1]):
                total = 0.0
                for k in range(n_i):
                    total += F[at_tail[e] + a * n_i + k] * x[left + k, c]
                for k in range(n_j):
                    total -= F[at_head[e] + a * n_j + k] * x[right + k, c]
                y[row[e] + a, c] = total


@jit
def adjoint_times(t, y, x):
    """X = delta^T y; y of shape (m, k), x of shape (n, k)."""
    column, tail, head, row, size = t.column, t.tail, t.head, t.row, t.size
    F, at_tail, at_head = t.F, t.at_tail, t.at_head
    x[:] = 0.0
    for e in range(len(tail)):
        i, j = tail[e], head[e]
        left, right = column[i], column[j]
        n_i, n_j = column[i + 1] - left, column[j + 1] - right
        for a in range(size[e]):
            for c in range(x.shape[1]):
                value = y[row[e] + a, c]
                for k in range(n_i):
                    x[left + k, c] += F[at_tail[e] + a * n_i + k] * value
                for k in range(n_j):
                    x[right + k, c] -= F[at_head[e] + a * n_j + k] * value


@allocating_jit
def block_row_lengths(t, place, columns, upper, indptr):
    """Fill the row pointers of the block of L that `fill_block` fills."""
    column, tail, head = t.column, t.tail, t.head
    first, incident = t.first, t.incident
    indptr[:] = 0
    last = np.full(len(place), -1, dtype=np.int64)
    begin = 0
    for u in columns:
        n_u = column[u + 1] - column[u]
        for at in range(first[u], first[u + 1]):
            e = incident[at]
            for v in (u, head[e] if tail[e] == u else tail[e]):
                if place[v] < 0 or last[v] == u or (upper and place[v] > begin):
                    continue
                last[v] = u
                for a in range(column[v + 1] - column[v]):
                    row = place[v] + a
                    skip = min(max(row + 1 - begin, 0), n_u) if upper else 0
                    indptr[row + 1] += n_u - skip
        begin += n_u
    for a in range(len(indptr) - 1):
        indptr[a + 1] += indptr[a]


@allocating_jit
def fill_block(t, place, columns, upper, sign, rows, diagonal):
    """Fill a block of sign * L.

    Columns are walked in order and append themselves to the rows that they meet: rows come out sorted without sorting.

    Args:
        t: the edges.
        place: first row of each vertex, or -1 where it has none, shape (V,).
        columns: vertices of the columns, in order.
        upper: whether to keep only what lies above the diagonal, and to put the diagonal into `diagonal`.
        sign: a factor.
        rows: (indptr, indices, values), compressed rows; values are zero before.
        diagonal: shape (rows,), zero before; not touched unless `upper`.
    """
    column, tail, head, size = t.column, t.tail, t.head, t.size
    F, at_tail, at_head = t.F, t.at_tail, t.at_head
    first, incident = t.first, t.incident
    indptr, indices, values = rows
    last = np.full(len(place), -1, dtype=np.int64)
    end = indptr[:-1].copy()  # of what each row has so far
    start = indptr[:-1].copy()  # of the row's newest block
    begin = 0
    for u in columns:
        n_u = column[u + 1] - column[u]
        for at in range(first[u], first[u + 1]):
            e = incident[at]
            from_tail = tail[e] == u
            at_u = at_tail[e] if from_tail else at_head[e]
            for own in range(2):
                v = u if own == 1 else (head[e] if from_tail else tail[e])
                if place[v] < 0 or (upper and place[v] > begin):
                    continue
                n_v = column[v + 1] - column[v]
                at_v = at_tail[e] if from_tail == (own == 1) else at_head[e]
                factor = sign if own == 1 else -sign
                new = last[v] != u
                last[v] = u
                for a in range(n_v):
                    row = place[v] + a
                    skip = min(max(row + 1 - begin, 0), n_u) if upper else 0
                    if new:
                        start[row] = end[row]
                        end[row] += n_u - skip
                        for b in range(skip, n_u):
                            indices[start[row] + b - skip] = begin + b
                    for b in range(max(skip - 1, 0), n_u):
                        if b < skip and row != begin + b:
                            continue
                        total = 0.0
                        for k in range(size[e]):
                            total += F[at_v + k * n_v + a] * F[at_u + k * n_u + b]
                        if b < skip:
                            diagonal[row] += factor * total
                        else:
                            values[start[row] + b - skip] += factor * total
        begin += n_u


@jit
def fill_band(t, place, band):
    """Add delta^T delta to a lower band: entry (i, j), i >= j, of the permuted matrix is band[j, i - j].

    Args:
        t: the edges.
        place: first row of each vertex in the permuted matrix, or -1 where it has none, shape (V,).
        band: shape (rows, bandwidth + 1), zero before: LAPACK's band storage, transposed.
    """
    column, tail, head, size = t.column, t.tail, t.head, t.size
    F, at_tail, at_head = t.F, t.at_tail, t.at_head
    for e in range(len(tail)):
        for one in range(2):
            v = tail[e] if one == 0 else head[e]
            at_v = at_tail[e] if one == 0 else at_head[e]
            n_v = column[v + 1] - column[v]
            for two in range(2):
                u = tail[e] if two == 0 else head[e]
                if place[u] < 0 or place[v] < place[u]:  # -1 is below every other
                    continue
                at_u = at_tail[e] if two == 0 else at_head[e]
                n_u = column[u + 1] - column[u]
                factor = 1.0 if one == two else -1.0
                for a in range(n_v):
                    i = place[v] + a
                    for b in range(n_u):
                        j = place[u] + b
                        if i < j:
                            continue
                        total = 0.0
                        for k in range(size[e]):
                            total += F[at_v + k * n_v + a] * F[at_u + k * n_u + b]
                        band[j, i - j] += factor * total


@allocating_jit
def neighbours(t, free):
    """Compressed rows (values, indices, indptr) of the graph on the free vertices, parallel edges repeated."""
    tail, head = t.tail, t.head
    first, incident = t.first, t.incident
    indptr = np.zeros(len(free) + 1, dtype=np.int32)
    indices = np.empty(len(incident), dtype=np.int32)
    size = 0
    for v in range(len(free)):
        if free[v]:
            for at in range(first[v], first[v + 1]):
                e = incident[at]
                u = head[e] if tail[e] == v else tail[e]
                if free[u]:
                    indices[size] = u
                    size += 1
        indptr[v + 1] = size
    return np.ones(size, dtype=np.int8), indices[:size], indptr


@jit
def bandwidth(t, place):
    """Largest |i - j| over the entries of delta^T delta on the vertices with a place, which is their first row."""
    column, tail, head = t.column, t.tail, t.head
    widest = 0
    for v in range(len(place)):
        if place[v] >= 0:
            widest = max(widest, column[v + 1] - column[v] - 1)
    for e in range(len(tail)):
        i, j = tail[e], head[e]
        if place[i] >= 0 and place[j] >= 0:
            end_i, end_j = place[i] + column[i + 1] - column[i], place[j] + column[j + 1] - column[j]
            widest = max(widest, max(end_i, end_j) - 1 - min(place[i], place[j]))
    return widest
