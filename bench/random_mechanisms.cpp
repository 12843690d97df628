// Judges random mechanisms of joints of all kinds, by all methods and in several variants, against
// a reference in long double: joints to (1e-12 m + 4 eps coordinate)/sqrt(smallest kept pivot),
// energy, the motion. Prints each finding, which --only SEED reproduces, and a table. Arguments as
// in judge_program.h, with 1000 mechanisms by default.

#include "random_mechanisms.h"

#include "judge_program.h"

int main(int argc, char** argv) {
  namespace random_scenes = constraint_sim::engine::random_scenes;
  return random_scenes::main_of(argc, argv, 1000, [](std::uint64_t seed, const std::string& only) {
    return random_scenes::judge_mechanism(seed, only);
  });
}
