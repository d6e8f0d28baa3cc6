/* Calls of the C library that fail on demand: loaded before everything (LD_PRELOAD), so that
   Python, Arrow, GDAL, SQLite, OpenCV and FFmpeg all go through it. Only files below one folder
   count; nothing happens until fault_arm() is called. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum { WRITE = 1, SYNC = 2, RENAME = 4, READ = 8, OPEN = 16, MAKE = 32, CLOCK = 64 };
enum { ONCE, FROM_THEN_ON, SIGNAL, DELAY };

static char folder[PATH_MAX];
static size_t folder_length;
static int kinds, action, value, log_fd = -1;
static long at;
static long *seen; /* shared with the process that armed it: all operations, then by kind */

/* Count operations of `kind_mask` below `where` from now on; the `n`-th (from 1) fails with errno `what`
   (ONCE, FROM_THEN_ON), raises the signal `what`, or from it on each takes `what` ms longer. For
   CLOCK: from the n-th call on the time of day is `what` seconds less. n = 0 only counts. */
void fault_arm(const char *where, int kind_mask, int how, int what, long n)
{
    snprintf(folder, sizeof folder, "%s", where);
    folder_length = strlen(folder);
    action = how;
    value = what;
    at = n;
    if (!seen)
        seen = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (seen == MAP_FAILED) abort();
    memset(seen, 0, 4096);
    kinds = kind_mask;
}

/* How many operations of one kind there were, in this process and what it forked. */
long fault_seen(int kind) { return seen ? seen[1 + __builtin_ctz(kind)] : 0; }

/* Count an operation: its number among those asked for. */
static long counted(int kind)
{
    __sync_add_and_fetch(&seen[1 + __builtin_ctz(kind)], 1);
    return __sync_add_and_fetch(&seen[0], 1);
}

/* Write what happens to the files below the folder into an open file: one line each. */
void fault_log(int fd) { log_fd = fd; }

static void *real(const char *name) { return dlsym(RTLD_NEXT, name); }
#define REAL(name) \
    static __typeof__(&name) real_##name; \
    if (!real_##name) real_##name = (__typeof__(&name))real(#name)

static int below(const char *path)
{
    char whole[PATH_MAX * 2];
    if (!kinds || !path) return 0;
    if (path[0] != '/') {
        char here[PATH_MAX];
        if (!getcwd(here, sizeof here)) return 0;
        snprintf(whole, sizeof whole, "%s/%s", here, path);
        path = whole;
    }
    return !strncmp(path, folder, folder_length)
        && (path[folder_length] == '/' || path[folder_length] == 0);
}

static int path_of(int fd, char *path)
{
    char link[40];
    ssize_t n;
    int before = errno;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    n = readlink(link, path, PATH_MAX - 1);
    errno = before;
    path[n > 0 ? n : 0] = 0;
    return n > 0 && below(path);
}

static void tell(char what, const char *path, const char *other)
{
    char line[PATH_MAX * 2 + 8];
    static ssize_t (*out)(int, const void *, size_t);
    if (log_fd < 0) return;
    if (!out) out = (__typeof__(out))real("write");
    int n = snprintf(line, sizeof line, "%c\t%s\t%s\n", what, path, other ? other : "");
    if (out(log_fd, line, n) < 0) abort();
}

/* Whether an operation fails now; errno is set. */
static int fails(int kind)
{
    if (!(kinds & kind)) return 0;
    long now = counted(kind);
    if (!at || now < at) return 0;
    if (action == SIGNAL) {
        if (now == at) kill(getpid(), value);
        return 0;
    }
    if (action == DELAY) {
        struct timespec wait = {value / 1000, value % 1000 * 1000000L};
        nanosleep(&wait, NULL);
        return 0;
    }
    if (action == ONCE && now > at) return 0;
    errno = value;
    return 1;
}

#define ON_FD(kind, mark, fd, failure) \
    if (kinds) { \
        char path[PATH_MAX]; \
        if (path_of(fd, path)) { \
            if (fails(kind)) return failure; \
            tell(mark, path, NULL); \
        } \
    }

ssize_t write(int fd, const void *data, size_t n)
{
    REAL(write);
    ON_FD(WRITE, 'w', fd, -1)
    return real_write(fd, data, n);
}

ssize_t pwrite(int fd, const void *data, size_t n, off_t where)
{
    REAL(pwrite);
    ON_FD(WRITE, 'w', fd, -1)
    return real_pwrite(fd, data, n, where);
}

ssize_t pwrite64(int fd, const void *data, size_t n, off64_t where)
{
    REAL(pwrite64);
    ON_FD(WRITE, 'w', fd, -1)
    return real_pwrite64(fd, data, n, where);
}

ssize_t writev(int fd, const struct iovec *parts, int n)
{
    REAL(writev);
    ON_FD(WRITE, 'w', fd, -1)
    return real_writev(fd, parts, n);
}

size_t fwrite(const void *data, size_t size, size_t n, FILE *stream)
{
    REAL(fwrite);
    ON_FD(WRITE, 'w', fileno(stream), 0)
    return real_fwrite(data, size, n, stream);
}

ssize_t sendfile(int to, int from, off_t *where, size_t n)
{
    REAL(sendfile);
    ON_FD(READ, '-', from, -1)
    ON_FD(WRITE, 'w', to, -1)
    return real_sendfile(to, from, where, n);
}

ssize_t sendfile64(int to, int from, off64_t *where, size_t n)
{
    REAL(sendfile64);
    ON_FD(READ, '-', from, -1)
    ON_FD(WRITE, 'w', to, -1)
    return real_sendfile64(to, from, where, n);
}

int ftruncate(int fd, off_t n)
{
    REAL(ftruncate);
    ON_FD(WRITE, 'w', fd, -1)
    return real_ftruncate(fd, n);
}

int ftruncate64(int fd, off64_t n)
{
    REAL(ftruncate64);
    ON_FD(WRITE, 'w', fd, -1)
    return real_ftruncate64(fd, n);
}

ssize_t read(int fd, void *data, size_t n)
{
    REAL(read);
    ON_FD(READ, '-', fd, -1)
    return real_read(fd, data, n);
}

ssize_t pread(int fd, void *data, size_t n, off_t where)
{
    REAL(pread);
    ON_FD(READ, '-', fd, -1)
    return real_pread(fd, data, n, where);
}

ssize_t pread64(int fd, void *data, size_t n, off64_t where)
{
    REAL(pread64);
    ON_FD(READ, '-', fd, -1)
    return real_pread64(fd, data, n, where);
}

size_t fread(void *data, size_t size, size_t n, FILE *stream)
{
    REAL(fread);
    ON_FD(READ, '-', fileno(stream), 0)
    return real_fread(data, size, n, stream);
}

int fsync(int fd)
{
    REAL(fsync);
    ON_FD(SYNC, 's', fd, -1)
    return real_fsync(fd);
}

int fdatasync(int fd)
{
    REAL(fdatasync);
    ON_FD(SYNC, 's', fd, -1)
    return real_fdatasync(fd);
}

int rename(const char *old, const char *new)
{
    REAL(rename);
    if (kinds && below(new)) {
        if (fails(RENAME)) return -1;
        tell('r', old, new);
    }
    return real_rename(old, new);
}

int renameat(int a, const char *old, int b, const char *new)
{
    REAL(renameat);
    if (kinds && below(new)) {
        if (fails(RENAME)) return -1;
        tell('r', old, new);
    }
    return real_renameat(a, old, b, new);
}

int mkdir(const char *path, mode_t mode)
{
    REAL(mkdir);
    if (kinds && below(path) && fails(MAKE)) return -1;
    return real_mkdir(path, mode);
}

#define OPENS(name) \
    int name(const char *path, int flags, ...) \
    { \
        va_list rest; \
        va_start(rest, flags); \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0; \
        va_end(rest); \
        REAL(name); \
        if (kinds && below(path) && fails(OPEN)) return -1; \
        return real_##name(path, flags, mode); \
    }
OPENS(open)
OPENS(open64)

#define OPENS_AT(name) \
    int name(int at_fd, const char *path, int flags, ...) \
    { \
        va_list rest; \
        va_start(rest, flags); \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0; \
        va_end(rest); \
        REAL(name); \
        if (kinds && below(path) && fails(OPEN)) return -1; \
        return real_##name(at_fd, path, flags, mode); \
    }
OPENS_AT(openat)
OPENS_AT(openat64)

#define OPENS_STREAM(name) \
    FILE *name(const char *path, const char *mode) \
    { \
        REAL(name); \
        if (kinds && below(path) && fails(OPEN)) return NULL; \
        return real_##name(path, mode); \
    }
OPENS_STREAM(fopen)
OPENS_STREAM(fopen64)

static int back(void)
{
    return (kinds & CLOCK) && counted(CLOCK) >= at && at;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    REAL(clock_gettime);
    int result = real_clock_gettime(clock, now);
    if (clock == CLOCK_REALTIME && back()) now->tv_sec -= value;
    return result;
}

time_t time(time_t *now)
{
    struct timespec precise;
    clock_gettime(CLOCK_REALTIME, &precise);
    if (now) *now = precise.tv_sec;
    return precise.tv_sec;
}
