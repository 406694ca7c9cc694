// Text files of numbers in columns, as data sets have them: lines of tokens, parsed without regard
// to the locale. Stateless, thread-safe. Tokens point into the text that was given.
#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

#include "carmap/base/time.h"

namespace carmap {

struct TextLine {
  size_t number = 0;  ///< in the file, from 1
  std::vector<std::string_view> tokens;
};

/// Lines that hold anything; `#` starts a comment that runs to the end of its line. A byte order
/// mark at the beginning is left out.
std::vector<TextLine> SplitIntoLines(std::string_view text);

/// The whole token as a number; `nan` and `inf` are numbers.
std::optional<double> ParseNumber(std::string_view token);

/// All tokens as numbers, or nothing.
std::optional<std::vector<double>> ParseNumbers(const std::vector<std::string_view>& tokens);

/// A time in seconds, within 292 years of 0. Plain decimals are exact to the nanosecond, which a
/// double is not for seconds since 1970.
std::optional<Timestamp> ParseSeconds(std::string_view token);

}  // namespace carmap
