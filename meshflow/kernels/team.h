// Work handed to threads. What comes out must not depend on how many there are: each part writes where no other part does, and
// what is summed over parts is summed afterwards, in the order of the parts.
#pragma once
#include "interface.h"

namespace meshflow {

using Work = void (*)(const void* context, i64 part, i32 who);

// Where a caller's other thread writes 1 to stop a kernel: no part begins after it. Null: nobody stops it.
using Stop = const i32*;

// work(context, part, who) for the parts 0 to parts - 1, by at most so many threads; the caller is one of them, and returns when
// all parts are done. who: 0 to threads - 1, one number for each thread (the caller is 0): for room that a thread needs while it
// works. May be called from any thread, from several at once, and from within work.
// Returns false where it was stopped: some parts are then not done.
bool run_parts(i64 parts, i32 threads, Work work, const void* context, Stop stop = nullptr);

// How many threads the team has, beside its callers.
i32 team_threads();

template <class F> bool parallel_for(i64 parts, i32 threads, const F& work, Stop stop = nullptr) {
    return run_parts(
        parts, threads, [](const void* it, i64 part, i32 who) { (*static_cast<const F*>(it))(part, who); }, &work, stop);
}

// n things in blocks of so many: work(first, last, block, who), last not included.
template <class F> bool parallel_blocks(i64 n, i64 block, i32 threads, const F& work, Stop stop = nullptr) {
    return parallel_for(
        (n + block - 1) / block, threads,
        [&](i64 part, i32 who) { work(part * block, part * block + block < n ? part * block + block : n, part, who); }, stop);
}

}  // namespace meshflow
