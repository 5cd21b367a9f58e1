// The team of threads of this process. It is compiled for any machine of this architecture, because it needs no SIMD.
//
// Callers add their work to a list, and idle threads join the first work with a free seat. A caller runs all parts that no other
// thread takes, so no call waits for a thread that is busy elsewhere, and there is no deadlock. Threads are created when first
// needed, sleep when there is no work, and do not survive a `fork`: the child creates its own.
#include "team.h"

#include <atomic>

#if defined(_WIN32)
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#else
#include <pthread.h>
#include <signal.h>
#endif

namespace meshflow {
namespace {

constexpr i32 MOST = 1024;

void serve();

#if defined(_WIN32)
struct Lock {
    SRWLOCK it = SRWLOCK_INIT;
    void close() { AcquireSRWLockExclusive(&it); }
    void open() { ReleaseSRWLockExclusive(&it); }
};
struct Signal {
    CONDITION_VARIABLE it = CONDITION_VARIABLE_INIT;
    void wait(Lock& lock) { SleepConditionVariableSRW(&it, &lock.it, INFINITE, 0); }
    void wake_one() { WakeConditionVariable(&it); }
};
DWORD WINAPI begin(LPVOID) {
    serve();
    return 0;
}
bool start() {
    HANDLE thread = CreateThread(nullptr, 0, begin, nullptr, 0, nullptr);
    if (thread) CloseHandle(thread);
    return thread != nullptr;
}
void prepare() {}
#else
struct Lock {
    pthread_mutex_t it = PTHREAD_MUTEX_INITIALIZER;
    void close() { pthread_mutex_lock(&it); }
    void open() { pthread_mutex_unlock(&it); }
};
struct Signal {
    pthread_cond_t it = PTHREAD_COND_INITIALIZER;
    void wait(Lock& lock) { pthread_cond_wait(&it, &lock.it); }
    void wake_one() { pthread_cond_signal(&it); }
};
void* begin(void*) {
    serve();
    return nullptr;
}
// A thread with all signals blocked: Ctrl-C is for the thread of Python that waits for it.
bool start() {
    sigset_t all, before;
    pthread_attr_t how;
    if (pthread_attr_init(&how) != 0) return false;
    pthread_attr_setdetachstate(&how, PTHREAD_CREATE_DETACHED);
    pthread_attr_setstacksize(&how, std::size_t(1) << 20);
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    pthread_t thread;
    const bool made = pthread_create(&thread, &how, begin, nullptr) == 0;
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    pthread_attr_destroy(&how);
    return made;
}
void prepare();
#endif

struct Job {
    Work work;
    const void* context;
    i64 parts;
    i32 seats;
    Stop stop;
    std::atomic<i64> next{0};
    std::atomic<bool> stopped{false};
    i32 seated = 1, active = 0;  // the caller has a seat; active: threads of the team that work on it
    Signal left{};
    Job* behind = nullptr;

    void take_parts(i32 who) {
        for (i64 part; (part = next.fetch_add(1, std::memory_order_relaxed)) < parts;) {
            if (stop && *static_cast<const volatile i32*>(stop)) {
                stopped.store(true, std::memory_order_relaxed);
                return;
            }
            work(context, part, who);
        }
    }
    bool seat_free() const { return seated < seats && next.load(std::memory_order_relaxed) < parts; }
};

struct Team {
    Lock lock;
    Signal awake;
    Job* first = nullptr;
    i32 threads = 0;  // without the callers
};
Team team;

void serve() {
    team.lock.close();
    for (;;) {
        Job* job = team.first;
        while (job && !job->seat_free()) job = job->behind;
        if (!job) {
            team.awake.wait(team.lock);
            continue;
        }
        const i32 who = job->seated++;
        ++job->active;
        team.lock.open();
        job->take_parts(who);
        team.lock.close();
        if (--job->active == 0) job->left.wake_one();
    }
}

#if !defined(_WIN32)
// In the child of a fork there are no other threads, and none of their work.
void forked() {
    team.lock = Lock{};
    team.awake = Signal{};
    team.first = nullptr;
    team.threads = 0;
}
void close_for_fork() { team.lock.close(); }
void open_after_fork() { team.lock.open(); }
pthread_once_t once = PTHREAD_ONCE_INIT;
void listen() { pthread_atfork(close_for_fork, open_after_fork, forked); }
void prepare() { pthread_once(&once, listen); }
#endif

}  // namespace

bool run_parts(i64 parts, i32 threads, Work work, const void* context, Stop stop) {
    if (parts <= 0) return true;
    Job job{work, context, parts, threads, stop};
    if (job.seats > parts) job.seats = static_cast<i32>(parts);
    if (job.seats > MOST) job.seats = MOST;
    if (job.seats <= 1) {
        job.take_parts(0);
        return !job.stopped.load(std::memory_order_relaxed);
    }
    prepare();
    team.lock.close();
    while (team.threads < job.seats - 1 && start()) ++team.threads;
    Job** end = &team.first;
    while (*end) end = &(*end)->behind;
    *end = &job;
    for (i32 i = 1; i < job.seats; ++i) team.awake.wake_one();
    team.lock.open();
    job.take_parts(0);
    team.lock.close();
    for (end = &team.first; *end != &job;) end = &(*end)->behind;
    *end = job.behind;
    while (job.active) job.left.wait(team.lock);
    team.lock.open();
    return !job.stopped.load(std::memory_order_relaxed);
}

i32 team_threads() {
    team.lock.close();
    const i32 threads = team.threads;
    team.lock.open();
    return threads;
}

}  // namespace meshflow
