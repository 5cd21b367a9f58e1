// Parallel work. Results must not depend on the number of threads: no two parts write to the same place, and sums over parts are
// computed afterwards in the order of the parts.
#pragma once
#include "interface.h"

namespace meshflow {

using Work = void (*)(const void* context, i64 part, i32 who);

// Another thread of the caller writes 1 here to stop a kernel; no part begins afterwards. Null: it cannot be stopped.
using Stop = const i32*;

// Calls work(context, part, who) for the parts 0 to parts - 1 in at most `threads` threads, including that of the caller; returns
// when all parts are done. who: 0 to threads - 1, a number for each thread (0: the caller), e.g. for its work space. It may be
// called from any thread, from several at once, and from within work. Returns false if it was stopped; some parts are then not
// done.
bool run_parts(i64 parts, i32 threads, Work work, const void* context, Stop stop = nullptr);

// The number of threads of the team, without its callers.
i32 team_threads();

template <class F> bool parallel_for(i64 parts, i32 threads, const F& work, Stop stop = nullptr) {
    return run_parts(
        parts, threads, [](const void* it, i64 part, i32 who) { (*static_cast<const F*>(it))(part, who); }, &work, stop);
}

// Calls work(first, last, block, who), last not included, for n elements in blocks.
template <class F> bool parallel_blocks(i64 n, i64 block, i32 threads, const F& work, Stop stop = nullptr) {
    return parallel_for(
        (n + block - 1) / block, threads,
        [&](i64 part, i32 who) { work(part * block, part * block + block < n ? part * block + block : n, part, who); }, stop);
}

}  // namespace meshflow
