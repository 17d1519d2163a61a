#!/bin/sh
# Makes the streams of this folder and, of each, what ffmpeg decodes: NAME.framemd5 lists the frames with their time stamps and
# the md5 sums of their samples. Needs ffmpeg 5.1 with libx264, libx265, libvpx and libaom. The tests need none of it.
set -eu
cd "$(dirname "$0")"
rm -f ./*.mp4 ./*.mov ./*.mkv ./*.webm ./*.avi ./*.framemd5

source_of() { # WIDTHxHEIGHT FRAMES
    echo "-f lavfi -i testsrc2=size=$1:rate=25,noise=alls=6:allf=t:all_seed=7 -frames:v $2"
}
make() { # NAME SIZE FRAMES OPTIONS..
    name=$1 size=$2 frames=$3
    shift 3
    # shellcheck disable=SC2046
    ffmpeg -v error -y $(source_of "$size" "$frames") -fflags +bitexact -flags:v +bitexact "$@" "$name"
}
x264="-c:v libx264 -preset medium -crf 30 -threads 1 -pix_fmt yuv420p"
x265="-c:v libx265 -preset medium -crf 30 -pix_fmt yuv420p -x265-params log-level=none:pools=none:frame-threads=1"

# Sides that are no multiples of 16 are cropped.
make h264_bframes.mp4 130x94 24 $x264 -bf 3 -g 12
make h264_baseline.mov 96x64 12 $x264 -profile:v baseline -slices 3
make h264_full_range.mp4 96x64 6 $x264 -pix_fmt yuvj420p
make h264_bt709.mp4 96x64 6 $x264 -vf scale=out_color_matrix=bt709 -colorspace bt709 -color_primaries bt709 -color_trc bt709
make h264_aspect.mp4 96x64 6 $x264 -vf setsar=16/15
make h264_bframes.mkv 96x64 24 $x264 -bf 2 -g 12
make h264_bframes.avi 96x64 24 $x264 -bf 2 -g 12
make h264_fragments.mp4 96x64 24 $x264 -bf 2 -g 8 -movflags +frag_keyframe+empty_moov
ffmpeg -v error -y -i h264_bframes.mp4 -c copy -bsf:v h264_metadata=crop_left=6:crop_top=10 -fflags +bitexact h264_window.mp4
ffmpeg -v error -y -i h264_bframes.mp4 -c copy -ss 0.24 -fflags +bitexact h264_trimmed.mp4
ffmpeg -v error -y -i h264_bframes.mp4 -c copy -metadata:s:v rotate=90 -metadata com.android.capture.fps=240 \
    -movflags use_metadata_tags -fflags +bitexact h264_rotated.mp4
make hevc.mp4 130x94 24 $x265 -bf 3 -g 12
make hevc_10.mp4 96x64 24 $x265 -pix_fmt yuv420p10le -bf 3 -g 12
make hevc_hlg.mkv 96x64 8 $x265 -pix_fmt yuv420p10le -color_primaries bt2020 -color_trc arib-std-b67 -colorspace bt2020nc
make vp9.webm 130x94 20 -c:v libvpx-vp9 -crf 40 -b:v 0 -auto-alt-ref 1 -lag-in-frames 12 -pix_fmt yuv420p
make vp9_10.webm 96x64 8 -c:v libvpx-vp9 -profile:v 2 -crf 40 -b:v 0 -pix_fmt yuv420p10le
make vp9_444.webm 95x63 8 -c:v libvpx-vp9 -profile:v 1 -crf 40 -b:v 0 -pix_fmt yuv444p
make vp9.avi 96x64 8 -c:v libvpx-vp9 -crf 40 -b:v 0 -auto-alt-ref 0 -pix_fmt yuv420p
make av1.mp4 130x94 16 -c:v libaom-av1 -cpu-used 6 -crf 40 -b:v 0 -pix_fmt yuv420p
make av1_10.webm 95x63 8 -c:v libaom-av1 -cpu-used 6 -crf 40 -b:v 0 -pix_fmt yuv420p10le
make vp8.webm 130x94 20 -c:v libvpx -crf 30 -b:v 200k -auto-alt-ref 1 -lag-in-frames 12 -pix_fmt yuv420p
make mjpeg_420.avi 130x94 6 -c:v mjpeg -q:v 6 -pix_fmt yuvj420p
make mjpeg_422.mov 96x64 6 -c:v mjpeg -q:v 6 -pix_fmt yuvj422p

# Cropped exactly (unaligned), with the transform of JPEG that is the same on all processors.
for stream in *.mp4 *.mov *.mkv *.webm *.avi; do
    ffmpeg -v error -noautorotate -flags bitexact+unaligned -idct simple -i "$stream" -map 0:v:0 -fps_mode passthrough -enc_time_base -1 -f framemd5 - |
        grep -v '^#software' >"$stream.framemd5"
done
ls -l | awk '{ total += $5 } END { print total " bytes" }'
