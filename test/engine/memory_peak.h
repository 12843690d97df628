#pragma once

#include <fstream>
#include <string>

namespace constraint_sim::engine {

/// Growth of the peak memory of this process over the memory at construction [bytes]. Earlier tests
/// may have left memory to allocators and sanitizers.
class MemoryPeak {
 public:
  MemoryPeak() : start_(read("VmRSS:")) {
    std::ofstream("/proc/self/clear_refs") << 5;  // resets the peak
  }
  double grown_by() const { return read("VmHWM:") - start_; }

 private:
  static double read(const std::string& key) {
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;)
      if (double kilobytes = 0.0; word == key && status >> kilobytes) return 1024.0 * kilobytes;
    return 1e300;  // unknown: every bound fails
  }
  double start_;
};

}  // namespace constraint_sim::engine
