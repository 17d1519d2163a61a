// The instructions that libtorch's own CPU kernels were dispatched to.

#include <cstddef>
#include <cstring>
#include <string>

#include <ATen/Version.h>

extern "C" {

// Writes the name to `text`, at most `size` bytes with the 0 at its end.
void paig_cpu_capability(char *text, size_t size) {
  std::string name = at::get_cpu_capability();
  std::strncpy(text, name.c_str(), size - 1);
  text[size - 1] = 0;
}

}
