#include "carmap/dataset/text_table.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <system_error>

namespace carmap {
namespace {

constexpr std::string_view kSpaces = " \t\r\f\v";
constexpr std::string_view kDigits = "0123456789";

void SplitIntoTokens(std::string_view line, std::vector<std::string_view>& tokens) {
  tokens.clear();
  for (size_t begin = line.find_first_not_of(kSpaces); begin != std::string_view::npos;) {
    const size_t end = tokens.size() + 1 < TextLines::kMaxTokens
                           ? std::min(line.find_first_of(kSpaces, begin), line.size())
                           : line.size();
    tokens.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(kSpaces, end);
  }
}

bool IsDigits(std::string_view text) {
  return text.find_first_not_of(kDigits) == std::string_view::npos;
}

int64_t ParseDigits(std::string_view digits) {
  int64_t value = 0;
  for (const char digit : digits) value = value * 10 + (digit - '0');
  return value;
}

}  // namespace

TextLines::TextLines(std::string_view text) : rest_(text) {
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  if (rest_.starts_with(kByteOrderMark)) rest_.remove_prefix(kByteOrderMark.size());
}

size_t TextLines::MaxCount(std::string_view text, size_t columns) {
  const auto ends = static_cast<size_t>(std::count(text.begin(), text.end(), '\n'));
  return std::min(ends + 1, (text.size() + 1) / (2 * columns));
}

const TextLine* TextLines::Next() {
  while (!rest_.empty()) {
    ++line_.number;
    const size_t end = std::min(rest_.find('\n'), rest_.size());
    const std::string_view line = rest_.substr(0, end);
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    SplitIntoTokens(line.substr(0, line.find('#')), line_.tokens);
    if (!line_.tokens.empty()) return &line_;
  }
  return nullptr;
}

std::optional<double> ParseNumber(std::string_view token) {
  double value = 0;
  const char* const end = token.data() + token.size();
  const auto [stop, error] = std::from_chars(token.data(), end, value);
  if (error != std::errc() || stop != end) return std::nullopt;
  return value;
}

std::optional<std::vector<double>> ParseNumbers(const std::vector<std::string_view>& tokens) {
  std::vector<double> numbers;
  numbers.reserve(tokens.size());
  for (const std::string_view token : tokens) {
    const std::optional<double> number = ParseNumber(token);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::optional<Timestamp> ParseSeconds(std::string_view token) {
  constexpr double kLimitSeconds = static_cast<double>(Timestamp::kMaxNs) * 1e-9;
  const std::optional<double> seconds = ParseNumber(token);
  if (!seconds || !(std::abs(*seconds) <= kLimitSeconds)) return std::nullopt;

  const bool is_negative = token.front() == '-';
  token.remove_prefix(is_negative ? 1 : 0);
  const size_t point = std::min(token.find('.'), token.size());
  const std::string_view whole = token.substr(0, point);
  const std::string_view fraction = token.substr(std::min(point + 1, token.size()));
  constexpr size_t kMaxWholeDigits = 10, kNanosecondDigits = 9;
  if (!IsDigits(whole) || !IsDigits(fraction) || whole.size() > kMaxWholeDigits ||
      fraction.size() > kNanosecondDigits) {
    return Timestamp::FromSeconds(*seconds);
  }
  int64_t ns = ParseDigits(fraction);
  for (size_t i = fraction.size(); i < kNanosecondDigits; ++i) ns *= 10;
  ns += ParseDigits(whole) * 1'000'000'000;
  return Timestamp{is_negative ? -ns : ns};
}

}  // namespace carmap
