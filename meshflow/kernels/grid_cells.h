// Which triangles exist, and which of their edges are borders.
//
// The loops run over the columns of samples, not over cells. Element j of a row of cells has the two triangles that share the
// edge from the sample (r, j) down to (r + 1, j): the upper triangle with P = (r, j), R = (r + 1, j), Q = (r, j + e), and the
// lower one with S = (r + 1, j), a leg along the column to (r, j) and a leg along the row to N = (r + 1, j - e). e is 1 for
// forward diagonals, -1 for backward ones. The first and the last element of a row have one triangle only and are processed
// separately.
//
// The code of an element has for the upper triangle the bits 1: it exists; 2, 4, 8: the edge opposite to P, Q, R is a border.
// For the lower one 16: it exists; 32, 64, 128: the edge opposite to S, to N, to the corner above S is a border.
#pragma once
#include "grid_loops.h"
#include "team.h"

namespace meshflow::grid {

constexpr i64 BLOCK = 16;  // elements of a block
constexpr u8 WHOLE = 17, BORDER = 238;
// The kind of a block, without the first and last element of a row: all triangles exist and there is no border; none exists; some
// exist; and some edges are borders.
enum Kind : u8 { PLAIN = 0, NONE = 1, HOLES = 2, BORDERS = 3 };

INLINE i64 blocks_of(i64 width) { return (width + BLOCK - 1) / BLOCK; }

// The codes of all triangles of a grid; equal rows are stored once.
struct Codes {
    const u8 *codes, *blocks;  // (rows, width), (rows, blocks)
    const i32* row_of;         // (2, height - 1): the row of each triangulation
    i64 height, width;

    const u8* row(int side, i64 r) const { return codes + row_of[side * (height - 1) + r] * width; }
    const u8* kinds(int side, i64 r) const { return blocks + row_of[side * (height - 1) + r] * blocks_of(width); }
    bool same(int side, i64 r) const { return row_of[side * (height - 1) + r] == row_of[side * (height - 1) + r - 1]; }
};

// Calls work(kind, from, to) for runs of blocks of one kind among elements first to last - 1; those at the ends of a row
// separately.
template <class F> INLINE void for_runs(const u8* code, const u8* kinds, i64 width, i64 first, i64 last, const F& work) {
    const auto at_end = [&](i64 j) { work(code[j] & BORDER ? BORDERS : HOLES, j, j + 1); };
    i64 j = first;
    if (j == 0 && j < last) at_end(j++);
    const i64 stop = least(last, width - 1);
    while (j < stop) {
        const u8 kind = kinds[j / BLOCK];
        i64 block = j / BLOCK + 1;
        while (block * BLOCK < stop && kinds[block] == kind) ++block;
        const i64 to = least(block * BLOCK, stop);
        work(static_cast<Kind>(kind), j, to);
        j = to;
    }
    if (last == width && j < last) at_end(j);
}

}  // namespace meshflow::grid

namespace meshflow {

// The codes of a triangulation (0 forward, 1 backward), and the kinds of their blocks.
// there (m, n): the bits of surfaces.triangles.triangles_there; borders: whether border edges are marked.
inline i64 laid_out(i64 m, i64 n, i64 width, i64 blocks, const u8* there, i64 which, i64 borders, u8* codes, u8* kinds,
                    i32 threads) {
    using namespace grid;
    if (width != n + 1 || blocks != blocks_of(width)) return BAD_SIZES;
    const u8 upper = static_cast<u8>(1 << (2 * which)), lower = static_cast<u8>(2 << (2 * which));
    const i64 side = 2 * which - 1;  // offset of the cell beside the column leg of the upper triangle
    parallel_for(m, m * n < (1 << 16) ? 1 : threads, [&](i64 r, i32) {
        const auto bits = [&](i64 row, i64 c) -> u8 {
            return row < 0 || row >= m || c < 0 || c >= n ? 0 : there[row * n + c];
        };
        u8* code = codes + r * width;
        for (i64 j = 0; j < width; ++j) {
            u8 found = 0;
            const i64 up = j - which, low = j - 1 + which;  // the cells of the two triangles
            if (bits(r, up) & upper) {
                found |= 1;
                if (borders)
                    found |= (bits(r, up) & lower ? 0 : 2) | (bits(r, up + side) & lower ? 0 : 4) |
                             (bits(r - 1, up) & lower ? 0 : 8);
            }
            if (bits(r, low) & lower) {
                found |= 16;
                if (borders)
                    found |= (bits(r, low) & upper ? 0 : 32) | (bits(r, low - side) & upper ? 0 : 64) |
                             (bits(r + 1, low) & upper ? 0 : 128);
            }
            code[j] = found;
        }
        for (i64 b = 0; b < blocks; ++b) {
            bool plain = true, none = true, bordered = false;
            for (i64 j = most(b * BLOCK, 1); j < least(b * BLOCK + BLOCK, width - 1); ++j)
                plain &= code[j] == WHOLE, none &= code[j] == 0, bordered |= (code[j] & BORDER) != 0;
            kinds[r * blocks + b] = plain ? PLAIN : none ? NONE : bordered ? BORDERS : HOLES;
        }
    });
    return 0;
}

}  // namespace meshflow
