// For tests of what is compiled for several kinds of processor: runs each of them.
#pragma once

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cstdint>
#include <string>

namespace carmap {

/// With INSTANTIATE_TEST_SUITE_P(Processors, SUITE, kProcessors, NameOfProcessor), each test of the
/// suite runs once for each kind of processor that this one can stand in for.
class OnEachProcessor : public ::testing::TestWithParam<int64_t> {
 protected:
  OnEachProcessor() { hwy::SetSupportedTargetsForTest(GetParam()); }
  ~OnEachProcessor() override { hwy::SetSupportedTargetsForTest(0); }
};

inline const auto kProcessors = ::testing::ValuesIn(hwy::SupportedAndGeneratedTargets());

inline std::string NameOfProcessor(const ::testing::TestParamInfo<int64_t>& info) {
  return hwy::TargetName(info.param);
}

}  // namespace carmap
