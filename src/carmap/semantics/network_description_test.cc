#include "carmap/semantics/network_description.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

namespace carmap {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class NetworkDescriptionTest : public testing::Test {
 protected:
  NetworkDescriptionTest() : folder_(fs::path(testing::TempDir()) / "carmap_description_test") {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    Write(json_.dump());
  }
  void Write(const std::string& text) const {
    std::ofstream(folder_ / "net.json", std::ios::binary) << text;
  }
  /// What is said of the changed description.
  std::string Error(const Json& json) const {
    Write(json.dump());
    return ErrorOfFile();
  }
  std::string ErrorOfFile() const {
    const auto description = ReadNetworkDescription(folder_ / "net.json");
    EXPECT_FALSE(description.ok());
    const std::string message(description.status().message());
    EXPECT_THAT(message, AllOf(HasSubstr("net.json: "), HasSubstr("; ")));
    EXPECT_EQ(message.find('\n'), std::string::npos);
    return message;
  }
  Json With(const char* field, Json value) const {
    Json json = json_;
    json["input"][field] = std::move(value);
    return json;
  }

  const fs::path folder_;
  const Json json_ = {{"input",
                       {{"channels", "rgb"},
                        {"mean", {1, 2, 3}},
                        {"scale", {0.5, 1, 2}},
                        {"multiple_of", 16},
                        {"max_width", 640}}},
                      {"classes", {"road", "car", "unlabelled"}}};
};

TEST_F(NetworkDescriptionTest, ReadsWhatIsBesideTheNetwork) {
  for (const char* name : {"net.onnx", "net.json"}) {
    const auto read = ReadNetworkDescription(folder_ / name);
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ(read->network, folder_ / "net.onnx");
    EXPECT_EQ(read->input_name, "");
    EXPECT_EQ(read->channels(), 3);
    EXPECT_THAT(read->mean, ElementsAre(1, 2, 3));
    EXPECT_THAT(read->scale, ElementsAre(0.5, 1, 2));
    EXPECT_THAT(read->of_class,
                ElementsAre(Mobility::kStatic, Mobility::kNonStatic, Mobility::kUnknown));
  }
}

TEST_F(NetworkDescriptionTest, MayNameANetworkElsewhere) {
  Json json = json_;
  json["model"] = "../other/x.onnx";
  json["input"]["name"] = "image";
  Write(json.dump());
  auto read = ReadNetworkDescription(folder_ / "net.json");
  EXPECT_EQ(read->network, folder_ / "../other/x.onnx");
  EXPECT_EQ(read->input_name, "image");
  json["model"] = "/far/x.onnx";
  Write(json.dump());
  read = ReadNetworkDescription(folder_ / "net.json");
  EXPECT_EQ(read->network, "/far/x.onnx");
}

TEST_F(NetworkDescriptionTest, SizesAreFixedOrInMultiples) {
  auto read = ReadNetworkDescription(folder_ / "net.json");
  EXPECT_EQ(NetworkInputSize(*read, {640, 192}), cv::Size(640, 192));
  EXPECT_EQ(NetworkInputSize(*read, {1242, 375}), cv::Size(640, 192));  // 193.2 of 375
  EXPECT_EQ(NetworkInputSize(*read, {397, 120}), cv::Size(400, 128));   // never enlarged
  EXPECT_EQ(NetworkInputSize(*read, {640, 4}), cv::Size(640, 16));
  read->max_width = 650;  // no multiple: the one below
  EXPECT_EQ(NetworkInputSize(*read, {2000, 200}), cv::Size(640, 64));

  Json json = json_;
  json["input"] = {
      {"channels", "grey"}, {"mean", {0}}, {"scale", {1}}, {"width", 320}, {"height", 96}};
  Write(json.dump());
  read = ReadNetworkDescription(folder_ / "net.json");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->channels(), 1);
  EXPECT_EQ(NetworkInputSize(*read, {100, 400}), cv::Size(320, 96));
}

TEST_F(NetworkDescriptionTest, SaysWhatIsMissing) {
  fs::remove(folder_ / "net.json");
  const auto read = ReadNetworkDescription(folder_ / "net.onnx");
  EXPECT_TRUE(absl::IsNotFound(read.status()));
  EXPECT_THAT(std::string(read.status().message()),
              AllOf(HasSubstr("net.json: no such file"), HasSubstr("docs/segmenter_networks.md")));
  Json json = json_;
  json.erase("input");
  EXPECT_THAT(Error(json), HasSubstr("\"input\" must be an object"));
  json = json_;
  json.erase("classes");
  EXPECT_THAT(Error(json), HasSubstr("\"classes\" must be a list"));
  for (const char* field : {"channels", "mean", "scale", "multiple_of", "max_width"}) {
    json = json_;
    json["input"].erase(field);
    EXPECT_THAT(Error(json), HasSubstr('"' + std::string(field) + "\" must be"));
  }
}

TEST_F(NetworkDescriptionTest, RefusesWhatIsNoDescription) {
  for (const char* text : {"", "[]", "{", "\x80", "null", "{} {}"}) {
    Write(text);
    EXPECT_THAT(ErrorOfFile(), HasSubstr("not a JSON object")) << text;
  }
  Write(std::string(1'000'001, ' '));
  const auto read = ReadNetworkDescription(folder_ / "net.json");
  EXPECT_THAT(std::string(read.status().message()), HasSubstr("larger than the limit"));
  Write(std::string(1'000'000, '['));
  EXPECT_THAT(ErrorOfFile(), HasSubstr("not a JSON object"));
}

TEST_F(NetworkDescriptionTest, RefusesFieldsThatItDoesNotKnow) {
  Json json = json_;
  json["clases"] = 1;
  EXPECT_THAT(Error(json), HasSubstr("a field \"clases\", which is unknown"));
  EXPECT_THAT(Error(With("std", 1)), HasSubstr("\"input\" has a field \"std\""));
}

TEST_F(NetworkDescriptionTest, RefusesWrongTypesCountsAndNumbers) {
  EXPECT_THAT(Error(With("channels", "rgba")), HasSubstr("\"grey\", \"rgb\" or \"bgr\""));
  EXPECT_THAT(Error(With("channels", 3)), HasSubstr("\"channels\" must be a text"));
  EXPECT_THAT(Error(With("name", "")), HasSubstr("\"name\" must be a text"));
  EXPECT_THAT(Error(With("channels", "grey")),
              HasSubstr("\"mean\" must be a list of 1 finite number,"));
  for (const Json& mean : {Json({1, 2}), Json({1, 2, 3, 4}), Json(1), Json({1, 2, "3"}),
                           Json({1, 2, nullptr}), Json({1, 2, 1e7})}) {
    EXPECT_THAT(Error(With("mean", mean)),
                HasSubstr("\"mean\" must be a list of 3 finite numbers"));
    EXPECT_THAT(Error(With("scale", mean)), HasSubstr("\"scale\" must be a list of 3"));
  }
  std::string text = json_.dump();
  Write(text.replace(text.find("[1,2,3]"), 7, "[1,2,1e999]"));
  EXPECT_THAT(ErrorOfFile(), HasSubstr("; "));
  for (const Json& pixels : {Json(15), Json(8193), Json(-640), Json(640.5), Json("640"),
                             Json(uint64_t{1} << 63), Json(INT64_MIN)}) {
    EXPECT_THAT(Error(With("max_width", pixels)),
                HasSubstr("\"max_width\" must be a whole number"));
  }
  EXPECT_THAT(Error(With("multiple_of", 0)), HasSubstr("\"multiple_of\" must be a whole number"));
  EXPECT_THAT(Error(With("multiple_of", 641)), HasSubstr("\"max_width\" is less than"));
  EXPECT_THAT(Error(With("width", 640)), HasSubstr("must have either"));
}

TEST_F(NetworkDescriptionTest, RefusesClassesThatTellNothing) {
  Json json = json_;
  json["classes"] = {"road", "lorry"};
  EXPECT_THAT(Error(json), HasSubstr("its class \"lorry\" is unknown"));
  json["classes"] = {"road", 13};
  EXPECT_THAT(Error(json), HasSubstr("its class 13 is unknown"));
  json["classes"] = {"road", "static"};
  EXPECT_THAT(Error(json), HasSubstr("none of its classes is non-static"));
  json["classes"] = {"car", "unlabelled"};
  EXPECT_THAT(Error(json), HasSubstr("none of its classes is static"));
  json["classes"] = std::vector<std::string>(257, "car");
  EXPECT_THAT(Error(json), HasSubstr("at most 256"));
}

}  // namespace
}  // namespace carmap
