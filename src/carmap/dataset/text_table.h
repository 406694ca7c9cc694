// Text files of numbers in columns, as data sets have them: lines of tokens, parsed without regard
// to the locale. Functions are stateless and thread-safe. Tokens point into the text that was
// given.
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

/// The lines of a text that hold anything, one by one, so that no more is kept of a long file than
/// its reader keeps. `#` starts a comment that runs to the end of its line. A byte order mark at
/// the beginning is left out. Owned by one thread.
class TextLines {
 public:
  /// More columns than any file has; what follows them is one token.
  static constexpr size_t kMaxTokens = 64;

  explicit TextLines(std::string_view text);

  /// Null at the end. The line is there until the next call.
  const TextLine* Next();
  /// How many lines of so many columns a text can hold.
  static size_t MaxCount(std::string_view text, size_t columns);

 private:
  std::string_view rest_;
  TextLine line_;
};

/// The whole token as a number; `nan` and `inf` are numbers.
std::optional<double> ParseNumber(std::string_view token);

/// All tokens as numbers, or nothing.
std::optional<std::vector<double>> ParseNumbers(const std::vector<std::string_view>& tokens);

/// A time in seconds, within 3e9 s (95 years) of 0. Plain decimals are exact to the nanosecond,
/// which a double is not for seconds since 1970.
std::optional<Timestamp> ParseSeconds(std::string_view token);

}  // namespace carmap
