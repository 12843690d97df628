#pragma once

#include <fstream>
#include <string>

namespace constraint_sim::engine {

/// How much more memory this process has had since then than it had then [bytes]. Tests before may
/// have left any amount to allocators and sanitizers.
class MemoryPeak {
 public:
  MemoryPeak() : start_(read("VmRSS:")) {
    std::ofstream("/proc/self/clear_refs") << 5;  // the peak begins anew
  }
  double grown_by() const { return read("VmHWM:") - start_; }

 private:
  static double read(const std::string& key) {
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;)
      if (double kilobytes = 0.0; word == key && status >> kilobytes) return 1024.0 * kilobytes;
    return 1e300;  // not known: no bound holds
  }
  double start_;
};

}  // namespace constraint_sim::engine
