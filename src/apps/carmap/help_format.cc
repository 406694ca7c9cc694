#include "apps/carmap/help_format.h"

#include <CLI/CLI.hpp>
#include <sstream>
#include <vector>

namespace carmap {
namespace {

constexpr size_t kColumns = 100, kDescriptionColumn = 26;

/// Words joined by blanks, broken before the line would exceed `width`.
std::string Wrap(const std::vector<std::string>& words, size_t width, const std::string& indent) {
  std::string text;
  size_t line_begin = 0;
  for (const std::string& word : words) {
    if (!text.empty()) {
      const bool fits = text.size() - line_begin + 1 + word.size() <= width;
      text += fits ? " " : "\n";
      if (!fits) {
        line_begin = text.size();
        text += indent;
      }
    }
    text += word;
  }
  return text;
}

}  // namespace

HelpFormat::HelpFormat() { column_width(kDescriptionColumn); }

std::string HelpFormat::make_usage(const CLI::App* app, std::string name) const {
  std::vector<std::string> words = {"Usage:", name.empty() ? app->get_name() : name};
  if (!app->get_subcommands({}).empty()) words.push_back("COMMAND");
  for (const CLI::Option* option : app->get_options()) {
    if (!option->get_positional()) continue;
    words.push_back(option->get_name() + (option->get_items_expected_max() > 1 ? "..." : ""));
  }
  for (const bool is_required : {true, false}) {
    for (const CLI::Option* option : app->get_options()) {
      if (option->get_positional() || option->get_required() != is_required) continue;
      if (option == app->get_help_ptr()) continue;
      const std::string usage = option->get_name() + make_option_opts(option);
      words.push_back(is_required ? usage : "[" + usage + "]");
    }
  }
  return Wrap(words, kColumns, "         ") + "\n";
}

std::string HelpFormat::make_option_opts(const CLI::Option* option) const {
  const bool takes_value = !option->get_type_name().empty() && !option->get_positional();
  return takes_value ? " " + option->get_type_name() : "";
}

std::string HelpFormat::make_option_desc(const CLI::Option* option) const {
  std::istringstream description(option->get_description());
  std::vector<std::string> words;
  for (std::string word; description >> word;) words.push_back(word);
  return Wrap(words, kColumns - kDescriptionColumn, "");
}

}  // namespace carmap
