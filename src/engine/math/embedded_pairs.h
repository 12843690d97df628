#pragma once

#include <cmath>
#include <cstddef>

namespace constraint_sim::engine {

// Embedded pairs of explicit Runge-Kutta formulas. Stage s is at t + kC[s] h, with y + h Σ kA[s][j]
// k_j; row kA[kStages] gives the new state. With kNeedsNext, estimate() needs the derivative at the
// new state too.

/// Method of Dormand & Prince, 8(5,3), as in DOP853: Hairer, Nørsett & Wanner, Solving Ordinary
/// Differential Equations I, 2nd edition, section II.10. Stable on the imaginary axis up to 5.96.
struct DormandPrince8 {
  static constexpr int kOrder = 8;
  static constexpr std::size_t kStages = 12;
  static constexpr bool kNeedsNext = false;
  static constexpr int kErrorOrder = 9;  // order of the error estimate of a step
  static constexpr double kC[kStages] = {0.0,
                                         0.05260015195876773,
                                         0.0789002279381516,
                                         0.1183503419072274,
                                         0.2816496580927726,
                                         0.3333333333333333,
                                         0.25,
                                         0.3076923076923077,
                                         0.6512820512820513,
                                         0.6,
                                         0.8571428571428571,
                                         1.0};
  static constexpr double kA[kStages + 1][kStages] = {
      {0.0},
      {0.05260015195876773},
      {0.0197250569845379, 0.0591751709536137},
      {0.02958758547680685, 0.0, 0.08876275643042054},
      {0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792},
      {0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242},
      {0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125},
      {0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328,
       -0.015319437748624402, 0.008273789163814023},
      {0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
       20.154067550477894, -43.48988418106996},
      {0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
       15.279233632882423, -33.28821096898486, -0.020331201708508627},
      {-0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
       -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196},
      {2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
       27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,
       0.6433927460157636},
      {0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
       -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034,
       0.04471061572777259},
  };
  // Weights of the differences to the embedded formulas of order 5 and 3.
  static constexpr double kE5[kStages] = {0.01312004499419488,
                                          0.0,
                                          0.0,
                                          0.0,
                                          0.0,
                                          -1.2251564463762044,
                                          -0.4957589496572502,
                                          1.6643771824549864,
                                          -0.35032884874997366,
                                          0.3341791187130175,
                                          0.08192320648511571,
                                          -0.022355307863886294};
  static constexpr double kE3[kStages] = {-0.18980075407240762,
                                          0.0,
                                          0.0,
                                          0.0,
                                          0.0,
                                          4.450312892752409,
                                          1.8915178993145003,
                                          -5.801203960010585,
                                          -0.4226823213237919,
                                          -0.1521609496625161,
                                          0.20136540080403034,
                                          0.02265179219836082};
  // Weights of the difference to a formula of order 4, by the stages at 0, 1/3, 3/5 and 6/7. Its
  // order is the order of its quadrature, since Σ_j a_ij c_j^k = c_i^(k+1)/(k+1) there for k up to
  // 2.
  static constexpr double kE4[kStages] = {-0.05218774736491272,
                                          0.0,
                                          0.0,
                                          0.0,
                                          0.0,
                                          3.9900856200251362,
                                          1.8915178993145003,
                                          -5.801203960010585,
                                          0.3111643669578199,
                                          -0.24861156694646672,
                                          -0.13547522770326484,
                                          0.04471061572777259};
};

/// Method of Dormand & Prince, 5(4), J. Comp. Appl. Math. 6 (1980) 19. Stable on the imaginary axis
/// up to 0.99.
struct DormandPrince5 {
  static constexpr int kOrder = 5;
  static constexpr std::size_t kStages = 6;
  static constexpr bool kNeedsNext = true;
  static constexpr int kErrorOrder = 6;  // order of the error estimate of a step
  static constexpr double kC[kStages] = {0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0};
  static constexpr double kA[kStages + 1][kStages] = {
      {0.0},
      {1.0 / 5.0},
      {3.0 / 40.0, 9.0 / 40.0},
      {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
      {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
      {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0},
      {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0},
  };
  // Weights of the differences to embedded formulas, the last for the derivative at the new state.
  // kE4 is by Dormand & Prince.
  static constexpr double kE4[kStages + 1] = {
      -71.0 / 57600.0,    0.0,           71.0 / 16695.0, -71.0 / 1920.0,
      17253.0 / 339200.0, -22.0 / 525.0, 1.0 / 40.0};
  // Weights of the differences to a formula of order 3, by the stages at 0, 3/10 and 4/5, and to
  // the trapezoidal rule, of order 2. The order of the first is the order of its quadrature, since
  // Σ_j a_ij c_j = c_i²/2 there.
  static constexpr double kE3[kStages + 1] = {
      -7.0 / 1152.0, 0.0, 16.0 / 3339.0, 37.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0, 0.0};
  static constexpr double kE2[kStages + 1] = {
      -157.0 / 384.0,   0.0,         500.0 / 1113.0, 125.0 / 192.0,
      -2187.0 / 6784.0, 11.0 / 84.0, -1.0 / 2.0};
};

/// Method of Kutta, 3(2), Zeitschrift für Mathematik und Physik 46 (1901) 435, with the midpoint
/// rule as embedded formula. Exact where accelerations are constant.
struct Kutta3 {
  static constexpr int kOrder = 3;
  static constexpr std::size_t kStages = 3;
  static constexpr bool kNeedsNext = false;
  static constexpr int kErrorOrder = 3;  // order of the error estimate of a step
  static constexpr double kC[kStages] = {0.0, 1.0 / 2.0, 1.0};
  static constexpr double kA[kStages + 1][kStages] = {
      {0.0}, {1.0 / 2.0}, {-1.0, 2.0}, {1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0}};
  // Weights of the difference to the midpoint rule.
  static constexpr double kE2[kStages] = {1.0 / 6.0, -1.0 / 3.0, 1.0 / 6.0};
};

/// Method of Euler, without an error estimate: for steps whose error is rounding.
struct Euler {
  static constexpr int kOrder = 1;
  static constexpr std::size_t kStages = 1;
  static constexpr bool kNeedsNext = false;
  static constexpr int kErrorOrder = 2;  // order of the error of a step
  static constexpr double kC[kStages] = {0.0};
  static constexpr double kA[kStages + 1][kStages] = {{0.0}, {1.0}};
};

/// For each stage, whether the sum of forces over a step needs its forces; the stage after the last
/// is the first of the next step.
template <class Pair>
struct StagesWithForces {
  bool needed[Pair::kStages + 1] = {};

  constexpr StagesWithForces() {
    for (std::size_t s = 0; s < Pair::kStages; ++s) needed[s] = Pair::kA[Pair::kStages][s] != 0.0;
    needed[0] = needed[Pair::kStages] = true;
  }
};

}  // namespace constraint_sim::engine
