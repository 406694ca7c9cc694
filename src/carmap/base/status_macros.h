// Early return on a failed absl::Status or absl::StatusOr.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <utility>

#define CARMAP_RETURN_IF_ERROR(expression)                                \
  do {                                                                    \
    if (absl::Status carmap_status = (expression); !carmap_status.ok()) { \
      return carmap_status;                                               \
    }                                                                     \
  } while (false)

#define CARMAP_CONCAT_INNER(a, b) a##b
#define CARMAP_CONCAT(a, b) CARMAP_CONCAT_INNER(a, b)

/// CARMAP_ASSIGN_OR_RETURN(Type name, StatusOr-expression);
#define CARMAP_ASSIGN_OR_RETURN(target, expression) \
  CARMAP_ASSIGN_OR_RETURN_IMPL(CARMAP_CONCAT(carmap_status_or_, __LINE__), target, expression)
#define CARMAP_ASSIGN_OR_RETURN_IMPL(result, target, expression) \
  auto result = (expression);                                    \
  if (!result.ok()) return std::move(result).status();           \
  target = *std::move(result)
