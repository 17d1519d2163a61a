// What programs do on Linux before the constructors of libtorch and oneMKL, which take a third of a second and end the process with
// messages of their own: they refuse surroundings in which no command can work, and start over with the environment in which libtorch
// computes fastest.

#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/auxv.h>
#include <sys/resource.h>
#include <unistd.h>

// What the C libraries read from the environment before `main`. Results depend on none of it.
static char *const wanted[] = {
    // OpenMP's threads sleep while they wait: its default, to spin, makes a training several times slower as soon as anything else
    // runs on the machine.
    "OMP_WAIT_POLICY=passive",
    // Freed tensors stay with the process, in large pages: by default each one of some MB goes back to the kernel and is fetched
    // again, page by page, which takes a fifth of a training on frames of 64 x 64.
    "GLIBC_TUNABLES=glibc.malloc.mmap_threshold=4294967296:glibc.malloc.trim_threshold=17179869184:glibc.malloc.hugetlb=1",
};
enum { count_wanted = sizeof wanted / sizeof *wanted };

// Addresses that libtorch and its threads take at the least beside what is loaded, bytes.
static const unsigned long long least_addresses = 1ULL << 30;

static void end(int code, const char *line) {
    // Nothing can be done about a closed stderr.
    ssize_t written = write(STDERR_FILENO, line, strlen(line));
    (void)written;
    _exit(code);
}

// Bytes of addresses in use; 0 where /proc does not say.
static unsigned long long used_addresses(void) {
    char text[64] = {0};
    int file = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    if (file < 0)
        return 0;
    ssize_t length = read(file, text, sizeof text - 1);
    close(file);
    return length > 0 ? strtoull(text, NULL, 10) * (unsigned long long)sysconf(_SC_PAGESIZE) : 0;
}

static void check_surroundings(void) {
    char path[4096];
    if (!getcwd(path, sizeof path))
        end(2, "error: the working directory cannot be used: it was removed or denies access; change to another one\n");
    struct rlimit limit;
    if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) {
        unsigned long long used = used_addresses();
        if (limit.rlim_cur < used + least_addresses) {
            char line[160];
            double left = limit.rlim_cur > used ? (double)(limit.rlim_cur - used) : 0.0;
            snprintf(line, sizeof line,
                     "error: ulimit -v leaves %.2f GiB of addresses, at least 1 GiB is needed; raise it\n", left / (1ULL << 30));
            end(1, line);
        }
    }
}

// Whether an environment has a value for the name that a `NAME=VALUE` begins with.
static bool is_set(char *const *environment, const char *assignment) {
    size_t length = strchr(assignment, '=') + 1 - assignment;
    while (*environment && strncmp(*environment, assignment, length) != 0)
        environment++;
    return *environment;
}

// Starts the program over with what its environment lacks. A value that the user has set stands.
static void complete_environment(char **arguments, char **environment) {
    // Where the kernel grants more rights than the user has, the C library drops such settings, each time.
    if (getauxval(AT_SECURE))
        return;
    size_t length = 0;
    while (environment[length])
        length++;
    char **complete = calloc(length + count_wanted + 1, sizeof *complete);
    if (!complete)
        return;
    memcpy(complete, environment, length * sizeof *complete);
    size_t all = length;
    for (int i = 0; i < count_wanted; i++)
        if (!is_set(environment, wanted[i]))
            complete[all++] = wanted[i];
    // By its own path, which its name in the list of processes comes from.
    char program[4096] = {0};
    bool known = readlink("/proc/self/exe", program, sizeof program - 1) > 0;
    // Returns only on failure: the program goes on as it is, only slower.
    if (all > length && known)
        execve(program, arguments, complete);
    free(complete);
}

static void before(int count, char **arguments, char **environment) {
    (void)count;
    check_surroundings();
    complete_environment(arguments, environment);
}

__attribute__((section(".preinit_array"), used)) static void (*const before_libraries)(int, char **, char **) = before;
