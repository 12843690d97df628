#pragma once

// Programs that judge many random scenes on threads. They print a line for each finding, progress
// on stderr, and a table.
//
//   PROGRAM [--scenes N] [--seed 1] [--only SEED] [--method NAME] [--threads 2]
//
// NAME: auto, runge_kutta, runge_kutta_5, energy_momentum, sequential_impulses, variants. Exit
// status 1 if a wrong result is not reported, 2 for wrong arguments. `conflict`, joints that the
// engine calls contradictory but the reference satisfies, is printed and is no failure.

#include <atomic>
#include <cstdlib>
#include <mutex>
#include <thread>

#include "scene_judge.h"

namespace constraint_sim::engine::random_scenes {

constexpr std::uint64_t kProgressInterval = 10;  // [scenes]

struct Arguments {
  std::uint64_t first = 1;
  std::uint64_t scenes = 600;
  unsigned threads = 2;
  std::string method;
};

inline bool is_method(const std::string& name) {
  for (const Setting& setting : kSettings)
    if (name == setting.name) return true;
  return name == "variants";
}

inline bool read(int count, char** values, Arguments* arguments) {
  for (int i = 1; i < count; i += 2) {
    const std::string key = values[i];
    if (i + 1 == count) return false;
    const std::string value = values[i + 1];
    if (key == "--method") {
      arguments->method = value;
      if (!is_method(value)) return false;
      continue;
    }
    char* end = nullptr;
    const std::uint64_t number = std::strtoull(value.c_str(), &end, 10);
    if (value.empty() || *end != '\0') return false;
    if (key == "--scenes") {
      arguments->scenes = number;
    } else if (key == "--seed") {
      arguments->first = number;
    } else if (key == "--only") {
      arguments->first = number;
      arguments->scenes = 1;
    } else if (key == "--threads" && number > 0 && number <= 64) {
      arguments->threads = static_cast<unsigned>(number);
    } else {
      return false;
    }
  }
  return true;
}

inline bool is_silently_wrong(const Verdict& verdict) {
  for (const Finding& finding : verdict.findings)
    if (finding.is_silent()) return true;
  return false;
}

/// Calls `judge(seed, method)` for each seed.
template <class JudgeSeed>
int run(const Arguments& arguments, JudgeSeed judge) {
  std::vector<Verdict> verdicts(arguments.scenes);
  std::atomic<std::uint64_t> next{0};
  std::mutex output;
  std::uint64_t judged = 0;
  const auto work = [&] {
    for (std::uint64_t i = next++; i < arguments.scenes; i = next++) {
      verdicts[i] = judge(arguments.first + i, arguments.method);
      const std::lock_guard<std::mutex> lock(output);
      for (const Finding& finding : verdicts[i].findings)
        std::printf("%s\n", line_of(verdicts[i], finding).c_str());
      std::fflush(stdout);
      if (++judged % kProgressInterval == 0)
        std::fprintf(stderr, "%llu of %llu scenes\n", static_cast<unsigned long long>(judged),
                     static_cast<unsigned long long>(arguments.scenes));
    }
  };
  std::vector<std::thread> threads;
  for (unsigned i = 0; i < arguments.threads; ++i) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();

  std::map<std::pair<std::string, std::string>, int> table;
  std::uint64_t off = 0, followed = 0;
  for (const Verdict& verdict : verdicts) {
    off += is_silently_wrong(verdict) ? 1 : 0;
    followed += verdict.has_motion ? 1 : 0;
    for (const Finding& finding : verdict.findings) ++table[{finding.setting, finding.what}];
  }
  std::printf("\n%llu scenes, %llu with a reference, %llu silently wrong\n",
              static_cast<unsigned long long>(arguments.scenes),
              static_cast<unsigned long long>(followed), static_cast<unsigned long long>(off));
  for (const auto& [key, count] : table)
    std::printf("%-24s %-14s %4d\n", key.first.c_str(), key.second.c_str(), count);
  return off == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

/// Runs the program as above; returns its exit status.
template <class JudgeSeed>
int main_of(int argc, char** argv, std::uint64_t scenes, JudgeSeed judge) {
  Arguments arguments;
  arguments.scenes = scenes;
  if (!read(argc, argv, &arguments)) {
    std::fprintf(stderr,
                 "usage: %s [--scenes N] [--seed N] [--only SEED] [--method NAME] [--threads N]\n",
                 argv[0]);
    return 2;
  }
  return run(arguments, judge);
}

}  // namespace constraint_sim::engine::random_scenes
