#include "panel/programs.h"

#include <dlfcn.h>

namespace constraint_sim::panel {

std::string program(const std::string& name) {
  Dl_info library{};
  ::dladdr(reinterpret_cast<void*>(&program), &library);
  const std::string path = library.dli_fname == nullptr ? "" : library.dli_fname;
  return path.substr(0, path.rfind('/') + 1) + "constraint_sim/" + name;
}

}  // namespace constraint_sim::panel
