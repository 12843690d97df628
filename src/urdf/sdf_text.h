#pragma once

#include <string>

namespace constraint_sim {

/// Returns whether the first element of a text is `<sdf>`.
bool is_sdf(const std::string& text);

/// Throws std::invalid_argument for a text that would cost libsdformat unbounded time, memory or
/// stack, or make it open further files: elements nested more than 64 deep, more than 20 000
/// elements or 2000 of those with names, `<include>`, XML that parsers read differently, and
/// vectors with components that are missing or are not finite.
void check_sdf_text(const std::string& text);

}  // namespace constraint_sim
