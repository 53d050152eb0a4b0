/* SPDX-License-Identifier: Apache-2.0
 * Makes calls of the C library fail, for tests. Preload it (LD_PRELOAD) into a program.
 *
 * STGS_FAULT=CALL:N    the Nth call of CALL fails, as when memory or disk space has run out;
 *                      CALL:N+ also all later ones
 * STGS_FAULT_COUNTS=F  appends "CALL count" for every call to the file F when the program exits
 *
 * CALL is one of the names below. Calls count from the beginning of main(), over all threads.
 * Writes to the file that is standard error at the beginning always succeed: failures are reported
 * there. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

enum Call { MALLOC, READ, WRITE, FSYNC, RENAME, MMAP, THREAD, OPEN, CALLS };
static const char* const names[CALLS] = {"malloc", "read", "write",  "fsync",
                                         "rename", "mmap", "thread", "open"};
static atomic_long counts[CALLS];
static atomic_bool is_counting;
static enum Call failing = CALLS;
static long first = 0, last = 0;

/* Counts a call, and returns whether it is to fail. */
static int fails(enum Call call) {
  if (!atomic_load(&is_counting)) return 0;
  const long n = atomic_fetch_add(&counts[call], 1) + 1;
  return call == failing && n >= first && n <= last;
}

/* The next definition of a function; dlsym() itself may allocate. */
#define NEXT(function, name)                \
  static __typeof__(function)* next = NULL; \
  if (next == NULL) next = (__typeof__(function)*)dlsym(RTLD_NEXT, name)

/* glibc's allocator under its own names, which needs no dlsym(). */
extern void* __libc_malloc(size_t);
extern void* __libc_calloc(size_t, size_t);
extern void* __libc_realloc(void*, size_t);
extern void* __libc_memalign(size_t, size_t);

static void* no_memory(void) {
  errno = ENOMEM;
  return NULL;
}

void* malloc(size_t size) {
  return fails(MALLOC) ? no_memory() : __libc_malloc(size);
}
void* calloc(size_t count, size_t size) {
  return fails(MALLOC) ? no_memory() : __libc_calloc(count, size);
}
void* realloc(void* memory, size_t size) {
  return fails(MALLOC) ? no_memory() : __libc_realloc(memory, size);
}
void* memalign(size_t alignment, size_t size) {
  return fails(MALLOC) ? no_memory() : __libc_memalign(alignment, size);
}
void* aligned_alloc(size_t alignment, size_t size) {
  return memalign(alignment, size);
}
int posix_memalign(void** out, size_t alignment, size_t size) {
  void* const memory = memalign(alignment, size);
  if (memory == NULL) return ENOMEM;
  *out = memory;
  return 0;
}

static ssize_t io_error(int error) {
  errno = error;
  return -1;
}

ssize_t read(int file, void* out, size_t size) {
  NEXT(read, "read");
  return fails(READ) ? io_error(EIO) : next(file, out, size);
}
ssize_t pread(int file, void* out, size_t size, off_t offset) {
  NEXT(pread, "pread64");
  return fails(READ) ? io_error(EIO) : next(file, out, size, offset);
}
ssize_t pread64(int file, void* out, size_t size, off64_t offset) {
  return pread(file, out, size, offset);
}
static struct stat report; /* standard error */

static int is_report(int file) {
  struct stat status;
  return fstat(file, &status) == 0 && status.st_dev == report.st_dev &&
         status.st_ino == report.st_ino;
}

ssize_t write(int file, const void* bytes, size_t size) {
  NEXT(write, "write");
  if (is_report(file)) return next(file, bytes, size);
  return fails(WRITE) ? io_error(ENOSPC) : next(file, bytes, size);
}
ssize_t pwrite(int file, const void* bytes, size_t size, off_t offset) {
  NEXT(pwrite, "pwrite64");
  return fails(WRITE) ? io_error(ENOSPC) : next(file, bytes, size, offset);
}
ssize_t pwrite64(int file, const void* bytes, size_t size, off64_t offset) {
  return pwrite(file, bytes, size, offset);
}
int fsync(int file) {
  NEXT(fsync, "fsync");
  return fails(FSYNC) ? (int)io_error(EIO) : next(file);
}
int fdatasync(int file) {
  NEXT(fdatasync, "fdatasync");
  return fails(FSYNC) ? (int)io_error(EIO) : next(file);
}
int rename(const char* from, const char* to) {
  NEXT(rename, "rename");
  return fails(RENAME) ? (int)io_error(EIO) : next(from, to);
}
void* mmap(void* at, size_t size, int protection, int flags, int file, off_t offset) {
  NEXT(mmap, "mmap64");
  if (!fails(MMAP)) return next(at, size, protection, flags, file, offset);
  errno = ENOMEM;
  return MAP_FAILED;
}
void* mmap64(void* at, size_t size, int protection, int flags, int file, off64_t offset) {
  return mmap(at, size, protection, flags, file, offset);
}
int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*),
                   void* argument) {
  NEXT(pthread_create, "pthread_create");
  return fails(THREAD) ? EAGAIN : next(thread, attributes, run, argument);
}

static int open_next(int folder, const char* path, int flags, mode_t mode) {
  NEXT(openat, "openat64");
  return fails(OPEN) ? (int)io_error(EMFILE) : next(folder, path, flags, mode);
}
#define MODE_OF(flags)                          \
  mode_t mode = 0;                              \
  if (((flags) & (O_CREAT | O_TMPFILE)) != 0) { \
    va_list more;                               \
    va_start(more, flags);                      \
    mode = va_arg(more, mode_t);                \
    va_end(more);                               \
  }
int open(const char* path, int flags, ...) {
  MODE_OF(flags)
  return open_next(AT_FDCWD, path, flags, mode);
}
int open64(const char* path, int flags, ...) {
  MODE_OF(flags)
  return open_next(AT_FDCWD, path, flags, mode);
}
int openat(int folder, const char* path, int flags, ...) {
  MODE_OF(flags)
  return open_next(folder, path, flags, mode);
}
int openat64(int folder, const char* path, int flags, ...) {
  MODE_OF(flags)
  return open_next(folder, path, flags, mode);
}
/* As callers with _FORTIFY_SOURCE reach them. */
int __open_2(const char* path, int flags) {
  return open_next(AT_FDCWD, path, flags, 0);
}
int __open64_2(const char* path, int flags) {
  return open_next(AT_FDCWD, path, flags, 0);
}
int __openat_2(int folder, const char* path, int flags) {
  return open_next(folder, path, flags, 0);
}
ssize_t __read_chk(int file, void* out, size_t size, size_t room) {
  if (size > room) abort();
  return read(file, out, size);
}
ssize_t __pread_chk(int file, void* out, size_t size, off_t offset, size_t room) {
  if (size > room) abort();
  return pread(file, out, size, offset);
}
ssize_t __pread64_chk(int file, void* out, size_t size, off64_t offset, size_t room) {
  if (size > room) abort();
  return pread(file, out, size, offset);
}

static void write_counts(void) {
  atomic_store(&is_counting, 0);
  const char* const path = getenv("STGS_FAULT_COUNTS");
  FILE* const out = path == NULL ? NULL : fopen(path, "a");
  if (out == NULL) return;
  for (int i = 0; i < CALLS; ++i) fprintf(out, "%s %ld\n", names[i], atomic_load(&counts[i]));
  fclose(out);
}

static int (*real_main)(int, char**, char**);

static int counted_main(int count, char** arguments, char** environment) {
  const char* const fault = getenv("STGS_FAULT");
  const char* const number = fault == NULL ? NULL : strchr(fault, ':');
  for (int i = 0; number != NULL && i < CALLS; ++i) {
    if (strlen(names[i]) != (size_t)(number - fault) ||
        strncmp(names[i], fault, strlen(names[i])) != 0) {
      continue;
    }
    char* end = NULL;
    failing = (enum Call)i;
    first = strtol(number + 1, &end, 10);
    last = *end == '+' ? INT64_MAX : first;
  }
  fstat(STDERR_FILENO, &report);
  atexit(write_counts);
  atomic_store(&is_counting, 1);
  return real_main(count, arguments, environment);
}

int __libc_start_main(int (*program)(int, char**, char**), int count, char** arguments,
                      void (*begin)(void), void (*end)(void), void (*end_of_loader)(void),
                      void* stack_end) {
  typedef int (*Start)(int (*)(int, char**, char**), int, char**, void (*)(void), void (*)(void),
                       void (*)(void), void*);
  const Start next = (Start)dlsym(RTLD_NEXT, "__libc_start_main");
  real_main = program;
  return next(counted_main, count, arguments, begin, end, end_of_loader, stack_end);
}
