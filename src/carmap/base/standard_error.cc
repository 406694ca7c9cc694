#include "carmap/base/standard_error.h"

#include <cstdio>

namespace carmap {

void WriteToStandardError(std::string_view text) {
  std::fwrite(text.data(), 1, text.size(), stderr);
  std::fflush(stderr);
}

}  // namespace carmap
