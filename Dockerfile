# The live node and the offline tools in an image without a ROS installation:
#   docker build -t tactile_pose_fusion .
#   docker run --rm --net host --ipc host -v "$PWD:/work" -w /work tactile_pose_fusion run --params-file glove.yaml
# FEATURES chooses what is built in: ros (DDS), zenoh, train.
FROM rust:1.95-bookworm AS build
ARG FEATURES=ros,train
WORKDIR /src
COPY . .
RUN cargo build --release --locked --no-default-features --features "$FEATURES" --bins

FROM debian:bookworm-slim
# ONNX Runtime is optional: RTen is built in. Put libonnxruntime.so beside the binaries, or set ORT_DYLIB_PATH.
COPY --from=build /src/target/release/tpf /src/target/release/tactile_pose_fusion_node /usr/local/bin/
COPY --from=build /src/params /usr/local/share/tactile_pose_fusion/params
COPY --from=build /src/models /usr/local/share/tactile_pose_fusion/models
# A calibration or a recording that is written belongs to whoever runs the container, not to root.
RUN useradd --create-home tpf
USER tpf
WORKDIR /work
ENTRYPOINT ["tpf"]
CMD ["--help"]
