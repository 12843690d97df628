// Judges random scenes of rods, ropes, springs and balls, each by all methods and in several
// variants, against a reference in long double. Prints each finding, which --only SEED reproduces,
// and a table. Arguments as in judge_program.h, with 600 scenes by default.

#include "judge_program.h"

int main(int argc, char** argv) {
  namespace random_scenes = constraint_sim::engine::random_scenes;
  return random_scenes::main_of(argc, argv, 600, [](std::uint64_t seed, const std::string& only) {
    return random_scenes::judge_seed(seed, only);
  });
}
