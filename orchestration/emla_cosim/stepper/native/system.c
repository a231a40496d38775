/* Threads and a clock on POSIX and on Windows; see system.h.
 *
 * The atomic functions are those of gcc and clang, as this is always compiled by zig, which is clang.
 */
#ifndef _WIN32
#define _POSIX_C_SOURCE 200809L
#endif
#include "system.h"

#include <fenv.h>
#include <stdlib.h>

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#else
#include <locale.h>
#include <pthread.h>
#include <sched.h>
#include <time.h>
#endif
#ifdef __APPLE__
#include <xlocale.h>
#endif

#define STACK_SIZE (8u << 20) /* as that of the first thread: the default of some systems is too small for FMUs */

struct Thread {
    void (*work)(void *);
    void *argument;
    fenv_t arithmetic;
#ifdef _WIN32
    HANDLE handle; /* the locale is that of the process */
#else
    locale_t locale;
    pthread_t handle;
#endif
};

struct Gate {
    int32_t is_open;
#ifdef _WIN32
    SRWLOCK lock;
    CONDITION_VARIABLE opened;
#else
    pthread_mutex_t lock;
    pthread_cond_t opened;
#endif
};

static void set_open(Gate *gate, int32_t is_open) {
    __atomic_store_n(&gate->is_open, is_open, __ATOMIC_RELEASE);
}

static int is_closed(const Gate *gate) { return !__atomic_load_n(&gate->is_open, __ATOMIC_ACQUIRE); }

void gate_close(Gate *gate) { set_open(gate, 0); }

#ifdef _WIN32

static DWORD WINAPI run(LPVOID argument) {
    Thread *thread = argument;
    fesetenv(&thread->arithmetic);
    thread->work(thread->argument);
    return 0;
}

static int start(Thread *thread) {
    thread->handle = CreateThread(NULL, STACK_SIZE, run, thread, STACK_SIZE_PARAM_IS_A_RESERVATION, NULL);
    return thread->handle != NULL;
}

void thread_join(Thread *thread) {
    WaitForSingleObject(thread->handle, INFINITE);
    CloseHandle(thread->handle);
    free(thread);
}

void thread_yield(void) { SwitchToThread(); }

static int prepare(Gate *gate) {
    InitializeSRWLock(&gate->lock);
    InitializeConditionVariable(&gate->opened);
    return 1;
}

void gate_open(Gate *gate) {
    AcquireSRWLockExclusive(&gate->lock);
    set_open(gate, 1);
    WakeAllConditionVariable(&gate->opened);
    ReleaseSRWLockExclusive(&gate->lock);
}

static void wait_at(Gate *gate) {
    AcquireSRWLockExclusive(&gate->lock);
    while (is_closed(gate)) SleepConditionVariableSRW(&gate->opened, &gate->lock, INFINITE, 0);
    ReleaseSRWLockExclusive(&gate->lock);
}

void gate_free(Gate *gate) { free(gate); }

int64_t system_clock(void) {
    LARGE_INTEGER ticks, rate; /* the rate is constant, and read without a call of the kernel */
    QueryPerformanceCounter(&ticks);
    QueryPerformanceFrequency(&rate);
    const int64_t seconds = ticks.QuadPart / rate.QuadPart, rest = ticks.QuadPart % rate.QuadPart;
    return seconds * 1000000000 + rest * 1000000000 / rate.QuadPart;
}

#else

static void *run(void *argument) {
    Thread *thread = argument;
    fesetenv(&thread->arithmetic);
    uselocale(thread->locale);
    thread->work(thread->argument);
    return NULL;
}

static int start(Thread *thread) {
    pthread_attr_t attributes;
    thread->locale = uselocale((locale_t)0);
    if (pthread_attr_init(&attributes) != 0) return 0;
    pthread_attr_setstacksize(&attributes, STACK_SIZE);
    const int failure = pthread_create(&thread->handle, &attributes, run, thread);
    pthread_attr_destroy(&attributes);
    return failure == 0;
}

void thread_join(Thread *thread) {
    pthread_join(thread->handle, NULL);
    free(thread);
}

void thread_yield(void) { sched_yield(); }

static int prepare(Gate *gate) {
    if (pthread_mutex_init(&gate->lock, NULL) != 0) return 0;
    if (pthread_cond_init(&gate->opened, NULL) == 0) return 1;
    pthread_mutex_destroy(&gate->lock);
    return 0;
}

void gate_open(Gate *gate) {
    pthread_mutex_lock(&gate->lock);
    set_open(gate, 1);
    pthread_cond_broadcast(&gate->opened);
    pthread_mutex_unlock(&gate->lock);
}

static void wait_at(Gate *gate) {
    pthread_mutex_lock(&gate->lock);
    while (is_closed(gate)) pthread_cond_wait(&gate->opened, &gate->lock);
    pthread_mutex_unlock(&gate->lock);
}

void gate_free(Gate *gate) {
    pthread_cond_destroy(&gate->opened);
    pthread_mutex_destroy(&gate->lock);
    free(gate);
}

int64_t system_clock(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

#endif

Thread *thread_start(void (*work)(void *), void *argument) {
    Thread *thread = malloc(sizeof *thread);
    if (thread == NULL) return NULL;
    thread->work = work;
    thread->argument = argument;
    fegetenv(&thread->arithmetic);
    if (start(thread)) return thread;
    free(thread);
    return NULL;
}

Gate *gate_create(void) {
    Gate *gate = malloc(sizeof *gate);
    if (gate == NULL) return NULL;
    gate->is_open = 0;
    if (prepare(gate)) return gate;
    free(gate);
    return NULL;
}

void gate_pass(Gate *gate) {
    if (is_closed(gate)) wait_at(gate);
}
