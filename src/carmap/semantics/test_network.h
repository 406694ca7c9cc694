// ONNX files of one layer, for tests: the few fields of the format that they need.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "carmap/base/byte_io.h"

namespace carmap {

/// A Protocol Buffers message: fields by number, each a number or bytes.
class ProtoMessage {
 public:
  ProtoMessage& Add(uint32_t field, uint64_t number) {
    AppendVarint(field << 3, bytes_);
    AppendVarint(number, bytes_);
    return *this;
  }
  ProtoMessage& Add(uint32_t field, std::string_view bytes) {
    AppendVarint(field << 3 | 2, bytes_);
    AppendVarint(bytes.size(), bytes_);
    bytes_ += bytes;
    return *this;
  }
  ProtoMessage& Add(uint32_t field, const ProtoMessage& message) {
    return Add(field, std::string_view(message.bytes_));
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// score_of_class = weights of the class * channels of the pixel + bias of the class, by pixel.
struct TestNetwork {
  uint64_t channels = 1;
  std::vector<float> weights;  ///< class by class, by channel
  std::vector<float> biases;   ///< by class
  bool is_flat = false;        ///< the output has two dimensions
  bool has_two_outputs = false;

  std::string Onnx() const;

 private:
  static constexpr uint64_t kFloat = 1;

  static ProtoMessage Tensor(std::string_view name, const std::vector<uint64_t>& sizes,
                             const std::vector<float>& values) {
    ProtoMessage tensor;
    for (const uint64_t size : sizes) tensor.Add(1, size);
    std::string bytes;
    for (const float value : values) AppendFloat(value, bytes);
    return tensor.Add(2, kFloat).Add(8, name).Add(9, bytes);
  }
  /// An input or output of the network; sizes of 0 are open.
  static ProtoMessage Value(std::string_view name, const std::vector<uint64_t>& sizes) {
    ProtoMessage shape;
    for (const uint64_t size : sizes) {
      shape.Add(1, size > 0 ? ProtoMessage().Add(1, size) : ProtoMessage().Add(2, "open"));
    }
    const ProtoMessage tensor = ProtoMessage().Add(1, kFloat).Add(2, shape);
    return ProtoMessage().Add(1, name).Add(2, ProtoMessage().Add(1, tensor));
  }
  static ProtoMessage Node(std::string_view kind, const std::vector<std::string>& inputs,
                           std::string_view output) {
    ProtoMessage node;
    for (const std::string& input : inputs) node.Add(1, input);
    return node.Add(2, output).Add(3, output).Add(4, kind);
  }
};

inline std::string TestNetwork::Onnx() const {
  constexpr uint64_t kInts = 7, kVersion = 7, kOpset = 11;
  const auto kernel_shape =
      ProtoMessage().Add(1, "kernel_shape").Add(8, 1).Add(8, 1).Add(20, kInts);
  ProtoMessage graph;
  graph.Add(1, Node("Conv", {"image", "weights", "biases"}, "scores").Add(5, kernel_shape));
  if (is_flat) graph.Add(1, Node("Flatten", {"scores"}, "flat"));
  if (has_two_outputs)
    graph.Add(1, Node("Relu", {"scores"}, "a")).Add(1, Node("Sigmoid", {"scores"}, "b"));
  graph.Add(2, "graph");
  graph.Add(5, Tensor("weights", {biases.size(), channels, 1, 1}, weights));
  graph.Add(5, Tensor("biases", {biases.size()}, biases));
  graph.Add(11, Value("image", {1, channels, 0, 0}));
  if (has_two_outputs) {
    graph.Add(12, Value("a", {1, biases.size(), 0, 0}))
        .Add(12, Value("b", {1, biases.size(), 0, 0}));
  } else {
    graph.Add(12, Value(is_flat ? "flat" : "scores", {1, biases.size(), 0, 0}));
  }
  const ProtoMessage opset = ProtoMessage().Add(2, kOpset);
  return ProtoMessage().Add(1, kVersion).Add(7, graph).Add(8, opset).bytes();
}

}  // namespace carmap
