// The option --segmenter, which several commands have: what tells static from non-static.
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

namespace carmap {

/// For the footer of a command's help: what --segmenter may be given. Ends without a new line.
extern const char* const kSegmenterHelp;

/// Adds `--segmenter`, "none" unless the user gives another; MakeSegmenter understands the value.
void AddSegmenterOption(CLI::App& command, std::string& segmenter);

/// The files and folders that a segmenter is read from, for CheckOutputs.
std::vector<std::string> FilesOfSegmenter(const std::string& segmenter, const std::string& drive);

}  // namespace carmap
