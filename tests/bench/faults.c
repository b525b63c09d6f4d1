/* File operations that fail, for `reliability.py`: preloaded into a command.

   The environment variable PSGN_FAULT is KIND:ERRNO:NUMBER:FOLDER. Every operation that changes a
   file below FOLDER is counted, in each process. The fault begins at operation NUMBER:
   'e' the operation fails with ERRNO;
   'f' the operation and all later ones fail with ERRNO if they need room on the disk;
   's' the operation, a write, writes half of its bytes;
   'k' the process is killed after the operation. */

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
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static char folder[PATH_MAX];
static int kind, error_number;
static long at;
static volatile long count;

__attribute__((constructor)) static void arm(void) {
  const char *fault = getenv("PSGN_FAULT");
  char letter;
  if (fault && sscanf(fault, "%c:%d:%ld:%4095s", &letter, &error_number, &at, folder) == 4)
    kind = letter;
}

static int below(const char *path) {
  return folder[0] && !strncmp(path, folder, strlen(folder));
}

static int path_below(int directory, const char *path) {
  char link[64], base[PATH_MAX];
  if (!folder[0] || !path) return 0;
  if (path[0] == '/') return below(path);
  if (directory == AT_FDCWD) {
    if (!getcwd(base, sizeof base)) return 0;
  } else {
    snprintf(link, sizeof link, "/proc/self/fd/%d", directory);
    ssize_t size = readlink(link, base, sizeof base - 1);
    if (size < 0) return 0;
    base[size] = 0;
  }
  return below(base);
}

static int file_below(int file) { return path_below(file, "."); }

enum { GO, FAIL, HALF, KILL };

/* The fault of the next operation; `room` is 1 if the operation needs room on the disk. */
static int next_operation(int room) {
  long number = __sync_add_and_fetch(&count, 1);
  if (kind == 'e' && number == at) return FAIL;
  if (kind == 'f' && number >= at && room) return FAIL;
  if (kind == 's' && number == at) return HALF;
  if (kind == 'k' && number == at) return KILL;
  return GO;
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

#define CHANGE(concerned, room, call)          \
  do {                                         \
    if (!(concerned)) return call;             \
    int what = next_operation(room);           \
    if (what == FAIL) {                        \
      errno = error_number;                    \
      return -1;                               \
    }                                          \
    __typeof__(call) result = call;            \
    if (what == KILL) kill(getpid(), SIGKILL); \
    return result;                             \
  } while (0)

#define WRITING (O_WRONLY | O_RDWR | O_CREAT | O_TRUNC)
#define MODE(flags)                            \
  mode_t mode = 0;                             \
  if (flags & (O_CREAT | __O_TMPFILE)) {       \
    va_list list;                              \
    va_start(list, flags);                     \
    mode = va_arg(list, mode_t);               \
    va_end(list);                              \
  }

int open(const char *path, int flags, ...) {
  MODE(flags)
  CHANGE((flags & WRITING) && path_below(AT_FDCWD, path), 1, REAL(open)(path, flags, mode));
}
int open64(const char *path, int flags, ...) {
  MODE(flags)
  CHANGE((flags & WRITING) && path_below(AT_FDCWD, path), 1, REAL(open64)(path, flags, mode));
}
int openat(int d, const char *path, int flags, ...) {
  MODE(flags)
  CHANGE((flags & WRITING) && path_below(d, path), 1, REAL(openat)(d, path, flags, mode));
}
int openat64(int d, const char *path, int flags, ...) {
  MODE(flags)
  CHANGE((flags & WRITING) && path_below(d, path), 1, REAL(openat64)(d, path, flags, mode));
}

#define WRITE(file, size, call, halved)        \
  do {                                         \
    if (!file_below(file)) return call;        \
    int what = next_operation(1);              \
    if (what == FAIL) {                        \
      errno = error_number;                    \
      return -1;                               \
    }                                          \
    if (what == HALF && size > 1) return halved; \
    ssize_t result = call;                     \
    if (what == KILL) kill(getpid(), SIGKILL); \
    return result;                             \
  } while (0)

ssize_t write(int f, const void *data, size_t size) {
  WRITE(f, size, REAL(write)(f, data, size), REAL(write)(f, data, size / 2));
}
ssize_t pwrite(int f, const void *data, size_t size, off_t to) {
  WRITE(f, size, REAL(pwrite)(f, data, size, to), REAL(pwrite)(f, data, size / 2, to));
}
ssize_t pwrite64(int f, const void *data, size_t size, off64_t to) {
  WRITE(f, size, REAL(pwrite64)(f, data, size, to), REAL(pwrite64)(f, data, size / 2, to));
}
ssize_t writev(int f, const struct iovec *parts, int number) {
  WRITE(f, parts[0].iov_len, REAL(writev)(f, parts, number),
        REAL(write)(f, parts[0].iov_base, parts[0].iov_len / 2));
}

int rename(const char *from, const char *to) {
  CHANGE(path_below(AT_FDCWD, to), 0, REAL(rename)(from, to));
}
int renameat(int d, const char *from, int e, const char *to) {
  CHANGE(path_below(e, to), 0, REAL(renameat)(d, from, e, to));
}
int link(const char *from, const char *to) {
  CHANGE(path_below(AT_FDCWD, to), 1, REAL(link)(from, to));
}
int mkdir(const char *path, mode_t mode) {
  CHANGE(path_below(AT_FDCWD, path), 1, REAL(mkdir)(path, mode));
}
int mkdirat(int d, const char *path, mode_t mode) {
  CHANGE(path_below(d, path), 1, REAL(mkdirat)(d, path, mode));
}
int rmdir(const char *path) { CHANGE(path_below(AT_FDCWD, path), 0, REAL(rmdir)(path)); }
int unlink(const char *path) { CHANGE(path_below(AT_FDCWD, path), 0, REAL(unlink)(path)); }
int unlinkat(int d, const char *path, int flags) {
  CHANGE(path_below(d, path), 0, REAL(unlinkat)(d, path, flags));
}
int fsync(int f) { CHANGE(file_below(f), 1, REAL(fsync)(f)); }
int fdatasync(int f) { CHANGE(file_below(f), 1, REAL(fdatasync)(f)); }
int ftruncate(int f, off_t size) { CHANGE(file_below(f), 1, REAL(ftruncate)(f, size)); }
int ftruncate64(int f, off64_t size) { CHANGE(file_below(f), 1, REAL(ftruncate64)(f, size)); }
