// Surroundings in which no command can work, tried before the constructors of libtorch and oneMKL: these end the process with
// messages of their own. Linked into programs on Linux.

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

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

static void check(int count, char **arguments, char **environment) {
    (void)count, (void)arguments, (void)environment;
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

__attribute__((section(".preinit_array"), used)) static void (*const before_libraries)(int, char **, char **) = check;
