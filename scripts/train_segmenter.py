#!/usr/bin/env python3
"""The program's default segmentation network: told static from non-static by simulated drives.

  train_segmenter.py train --drives DRIVE... --validation DRIVE... --out NETWORK.onnx
  train_segmenter.py evaluate --network NETWORK.onnx --drives DRIVE...
  train_segmenter.py show --network NETWORK.onnx --out FOLDER IMAGE...

Drives are those of `carmap simulate --labels`; beside NETWORK.onnx lies NETWORK.json, which says how
the network is fed. `evaluate` and `show` run it like the program does, in OpenCV on one thread.
"""
import argparse
import collections
import json
import pathlib
import time

import cv2
import numpy as np
import torch
from torch import nn

NON_STATIC = (11, 18)  # Cityscapes train ids: person to bicycle
MEAN, SCALE = 110.0, 1 / 64  # of grey values
STRIDE = 16  # of the network's coarsest features; widths and heights are multiples of it
MAX_WIDTH = 624
CROP = (320, 160)  # width and height of a training sample
WIDTHS = (480, 720)  # of whole images, between which samples are scaled

cv2.setNumThreads(1)


def convolution(inputs, outputs, stride=1, dilation=1):
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, dilation, dilation, bias=False),
        nn.BatchNorm2d(outputs))


class Residual(nn.Module):
    def __init__(self, channels, dilation):
        super().__init__()
        self.first = convolution(channels, channels, dilation=dilation)
        self.second = convolution(channels, channels, dilation=dilation)

    def forward(self, x):
        return torch.relu(x + self.second(torch.relu(self.first(x))))


class Segmenter(nn.Module):
    """An encoder to 1/16 of the resolution and a decoder back to all of it, joined at each level."""

    def __init__(self, channels=(8, 24, 40, 64), dilations=((), (), (1,), (2, 4))):
        super().__init__()
        finer = (1,) + channels[:-1]
        self.down = nn.ModuleList(convolution(a, b, stride=2) for a, b in zip(finer, channels))
        self.blocks = nn.ModuleList(
            nn.Sequential(*(Residual(c, d) for d in ds)) for c, ds in zip(channels, dilations))
        self.up = nn.ModuleList(
            nn.ConvTranspose2d(b, a, 2, 2) for a, b in zip(channels, channels[1:]))
        self.merge = nn.ModuleList(convolution(a, a) for a in channels[:-1])
        self.logits = nn.ConvTranspose2d(channels[0], 2, 2, 2)

    def forward(self, x):
        skipped = []
        for down, blocks in zip(self.down, self.blocks):
            x = blocks(torch.relu(down(x)))
            skipped.append(x)
        for level in reversed(range(len(self.up))):
            x = torch.relu(self.merge[level](self.up[level](x) + skipped[level]))
        return self.logits(x)


def read_frames(drive, sides=(("image_0", "labels"), ("image_1", "labels_right"))):
    """Pairs of a grey image and a mask, 255 where it shows what is non-static and 0 elsewhere."""
    for images, labels in sides:
        for path in sorted((drive / images).glob("*.png")):
            label = cv2.imread(str(drive / labels / path.name), cv2.IMREAD_UNCHANGED)
            yield cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), cv2.inRange(label, *NON_STATIC)


def cut(frame, random):
    """A part of the frame as if the whole were of another width, about right in its shape."""
    height, width = frame[0].shape
    zoom = np.exp(random.uniform(*np.log(WIDTHS))) / width
    source = [min(int(c / min(2, zoom * random.uniform(0.9, 1.1))), 4 * c) for c in CROP]
    x, y = (random.integers(-s // 8, max(0, size - s) + s // 8 + 1)
            for s, size in zip(source, (width, height)))
    columns = np.clip(np.arange(x, x + source[0]), 0, width - 1)
    rows = np.clip(np.arange(y, y + source[1]), 0, height - 1)
    interpolation = cv2.INTER_AREA if source[0] > CROP[0] else cv2.INTER_LINEAR
    image, mask = (cv2.resize(part[rows][:, columns], CROP, interpolation=interpolation)
                   for part in frame)
    return image, mask > 127


def relight(image, random):
    """Another camera's image of the same: gain, offset, gamma, sharpness and noise."""
    image = 255 * (image / np.float32(255)) ** np.exp(random.normal(0, 0.15))
    image = (image - 110) * np.exp(random.normal(0, 0.15)) + 110 + random.normal(0, 10)
    if random.random() < 0.2:
        image = cv2.GaussianBlur(image, (0, 0), random.uniform(0.3, 1))
    image += random.normal(0, random.uniform(0, 3), image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def weights(image, mask):
    """What a pixel counts: more at outlines, and where features are found."""
    kernel = np.ones((7, 7), np.uint8)
    outline = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_GRADIENT, kernel)
    corner = np.zeros_like(outline)
    for point in cv2.FastFeatureDetector_create(10).detect(image):
        corner[int(point.pt[1]), int(point.pt[0])] = 1
    corner = cv2.dilate(corner, np.ones((3, 3), np.uint8))
    return (1 + 3 * outline + 8 * corner).astype(np.float32)


def sample(frames, random):
    image, mask = cut(frames[random.integers(len(frames))], random)
    if random.random() < 0.5:
        image, mask = image[:, ::-1], mask[:, ::-1]
    image = relight(image, random)
    return (image.astype(np.float32) - MEAN) * SCALE, mask.astype(np.int64), weights(image, mask)


def train(arguments):
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(arguments.threads)
    random = np.random.default_rng(arguments.seed)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    frames = [frame for drive in arguments.drives for frame in read_frames(drive)]
    network = Segmenter().to(device)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, arguments.rate, arguments.steps, pct_start=0.1)
    losses = []
    for step in range(1, arguments.steps + 1):
        images, masks, weight = (
            torch.from_numpy(np.stack(part)).to(device)
            for part in zip(*(sample(frames, random) for _ in range(arguments.batch))))
        loss = nn.functional.cross_entropy(network(images[:, None]), masks, reduction="none")
        loss = (loss * weight).sum() / weight.sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        losses.append(loss.item())
        if step % 100 == 0:
            print(f"step {step} of {arguments.steps}: loss {np.mean(losses[-100:]):.4f}",
                  flush=True)
    network = network.cpu().eval()
    write(network, arguments.out)
    offset = choose_offset(Network(arguments.out), arguments.validation)
    print(f"non-static logit offset by {offset:+.2f}")
    with torch.no_grad():
        network.logits.bias[1] += offset
    write(network, arguments.out)


def write(network, path):
    sizes = {2: "height", 3: "width"}
    torch.onnx.export(network, torch.zeros(1, 1, 192, 624), str(path), opset_version=11,
                      input_names=["image"], output_names=["logits"],
                      dynamic_axes={"image": sizes, "logits": sizes})
    about = {"input": {"channels": "grey", "mean": [MEAN], "scale": [SCALE],
                       "multiple_of": STRIDE, "max_width": MAX_WIDTH},
             "classes": ["static", "non-static"]}
    path.with_suffix(".json").write_text(json.dumps(about, indent=2) + "\n")


class Network:
    """A network as the program runs it."""

    def __init__(self, path):
        self.net = cv2.dnn.readNetFromONNX(str(path))
        self.input = json.loads(path.with_suffix(".json").read_text())["input"]
        self.seconds = collections.defaultdict(list)  # of processor time, by size

    def size(self, image):
        """Width and height to which an image is brought, as NetworkInputSize does."""
        height, width = image.shape
        multiple, widest = self.input["multiple_of"], self.input["max_width"]
        scale = min(1, widest / width)
        return [max(1, round(scale * side / multiple)) * multiple for side in (width, height)]

    def margin(self, image):
        """By how much non-static is the likelier, at each pixel."""
        size = self.size(image)
        interpolation = cv2.INTER_AREA if size[0] < image.shape[1] else cv2.INTER_LINEAR
        blob = cv2.resize(image, size, interpolation=interpolation).astype(np.float32)
        blob = (blob - self.input["mean"][0]) * self.input["scale"][0]
        begin = time.process_time()
        self.net.setInput(np.ascontiguousarray(blob[None, None], np.float32))
        logits = self.net.forward()[0]
        self.seconds["{}x{}".format(*size)].append(time.process_time() - begin)
        return cv2.resize(logits[1] - logits[0], image.shape[::-1],
                          interpolation=cv2.INTER_NEAREST)


def corners(image, scales=(1, 0.7, 0.5), cells=32, kept=2):
    """Rows and columns of the strongest FAST corners of each cell and scale."""
    rows, columns = [], []
    for scale in scales:
        level = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        points = cv2.FastFeatureDetector_create(10).detect(level)
        size = level.shape[1] / cells
        count = collections.Counter()
        for point in sorted(points, key=lambda p: -p.response):
            x, y = point.pt
            cell = int(x / size), int(y / size)
            if count[cell] < kept:
                count[cell] += 1
                columns.append(min(int((x + 0.5) / scale), image.shape[1] - 1))
                rows.append(min(int((y + 0.5) / scale), image.shape[0] - 1))
    return np.array(rows, int), np.array(columns, int)


def choose_offset(network, drives):
    """The offset at which one static corner in 25 is lost: keyframes vote, and outvote that."""
    margins = []
    for drive in drives:
        for image, mask in read_frames(drive):
            at = corners(image)
            margins.append(network.margin(image)[at][mask[at] == 0])
    return -np.quantile(np.concatenate(margins), 0.96)


def confusion(truth, label):
    """Counts by truth and label, each first static, then non-static."""
    return np.bincount((2 * truth + label).ravel(), minlength=4).reshape(2, 2)


def evaluate(arguments):
    network = Network(arguments.network)
    pixels = collections.defaultdict(lambda: np.zeros((2, 2)))
    features = collections.defaultdict(lambda: np.zeros((2, 2)))
    for drive in arguments.drives:
        options = json.loads((drive / "world.json").read_text())["options"]
        size = "{}x{}".format(*options["size"])
        groups = "all", options["scene"], options["light"], options["traffic"], size
        for image, mask in read_frames(drive):
            truth, label = mask > 0, network.margin(image) > 0
            at = corners(image)
            for group in groups:
                pixels[group] += confusion(truth, label)
                features[group] += confusion(truth[at], label[at])
    print("| drives | pixels right | IoU static | IoU non-static | corners | non-static found "
          "| static lost |\n|---|---|---|---|---|---|---|")
    for group, p in pixels.items():
        iou = p.diagonal() / (p.sum(0) + p.sum(1) - p.diagonal())
        f = features[group]
        wrong = f[[0, 1], [1, 0]] / f.sum(1)
        print(f"| {group} | {p.trace() / p.sum():.2%} | {iou[0]:.2%} | {iou[1]:.2%} "
              f"| {f.sum():.0f} | {1 - wrong[1]:.2%} | {wrong[0]:.2%} |")
    for size, seconds in network.seconds.items():
        print(f"{size}: {1000 * np.median(seconds):.1f} ms an image")


def show(arguments):
    network = Network(arguments.network)
    arguments.out.mkdir(parents=True, exist_ok=True)
    for path in arguments.images:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        painted = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        painted[network.margin(image) > 0, 2] = 255
        cv2.imwrite(str(arguments.out / "-".join(path.parts[-3:])), painted)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    command = commands.add_parser("train")
    command.add_argument("--drives", nargs="+", type=pathlib.Path, required=True)
    command.add_argument("--validation", nargs="+", type=pathlib.Path, required=True)
    command.add_argument("--out", type=pathlib.Path, required=True)
    command.add_argument("--seed", type=int, default=1)
    command.add_argument("--steps", type=int, default=4500)
    command.add_argument("--batch", type=int, default=8)
    command.add_argument("--rate", type=float, default=4e-3)
    command.add_argument("--threads", type=int, default=2)
    command.set_defaults(run=train)
    command = commands.add_parser("evaluate")
    command.add_argument("--network", type=pathlib.Path, required=True)
    command.add_argument("--drives", nargs="+", type=pathlib.Path, required=True)
    command.set_defaults(run=evaluate)
    command = commands.add_parser("show")
    command.add_argument("--network", type=pathlib.Path, required=True)
    command.add_argument("--out", type=pathlib.Path, required=True)
    command.add_argument("images", nargs="+", type=pathlib.Path)
    command.set_defaults(run=show)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
