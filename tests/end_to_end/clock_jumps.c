// The time of day jumps by a year, forth and back, every twentieth time that it is asked for.
// Loaded into a program by LD_PRELOAD; clocks that only grow are left alone.
#define _GNU_SOURCE
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static long jump(void) {
  static unsigned asked;
  static const long places[] = {0, 31536000, -31536000, -1, 86400};
  return places[__atomic_fetch_add(&asked, 1, __ATOMIC_RELAXED) / 20 % 5];
}

int clock_gettime(clockid_t clock, struct timespec *found) {
  int failed = (int)syscall(SYS_clock_gettime, clock, found);
  if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) {
    found->tv_sec += jump();
  }
  return failed;
}

int gettimeofday(struct timeval *restrict found, void *restrict zone) {
  struct timespec now;
  (void)zone;
  syscall(SYS_clock_gettime, CLOCK_REALTIME, &now);
  found->tv_sec = now.tv_sec + jump();
  found->tv_usec = now.tv_nsec / 1000;
  return 0;
}

time_t time(time_t *found) {
  struct timeval now;
  gettimeofday(&now, 0);
  if (found) {
    *found = now.tv_sec;
  }
  return now.tv_sec;
}
