#include "carmap/semantics/default_segmenter.h"

#include <cstddef>
#include <string_view>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/semantics/network_description.h"
#include "carmap/semantics/onnx_segmenter.h"

// The files' bytes, as they are.
asm(R"(
  .pushsection .rodata
  .balign 8
  carmap_default_segmenter_onnx_begin:
  .incbin ")" CARMAP_DEFAULT_SEGMENTER R"(.onnx"
  carmap_default_segmenter_onnx_end:
  carmap_default_segmenter_json_begin:
  .incbin ")" CARMAP_DEFAULT_SEGMENTER R"(.json"
  carmap_default_segmenter_json_end:
  .popsection
)");
extern const char onnx_begin[] asm("carmap_default_segmenter_onnx_begin");
extern const char onnx_end[] asm("carmap_default_segmenter_onnx_end");
extern const char json_begin[] asm("carmap_default_segmenter_json_begin");
extern const char json_end[] asm("carmap_default_segmenter_json_end");

namespace carmap {
namespace {

std::string_view Between(const char* begin, const char* end) {
  return {begin, static_cast<size_t>(end - begin)};
}

}  // namespace

absl::StatusOr<std::unique_ptr<Segmenter>> MakeDefaultSegmenter(cv::Size image) {
  CARMAP_ASSIGN_OR_RETURN(
      NetworkDescription description,
      ParseNetworkDescription(Between(json_begin, json_end), CARMAP_DEFAULT_SEGMENTER ".json"));
  return MakeOnnxSegmenter(Between(onnx_begin, onnx_end), std::move(description), image);
}

}  // namespace carmap
