// JPEGs become bitmaps beside the page: making a Blob alone holds up keys for milliseconds while the machine is busy.

const BESIDE = `onmessage = async ({ data: [id, jpeg] }) => {
  const image = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })).catch(() => null);
  postMessage([id, image], image ? [image] : []);
};`;

interface Waiting {
  jpeg: Uint8Array<ArrayBuffer>;
  settle: (image: ImageBitmap | Promise<ImageBitmap>) => void;
  refuse: (error: Error) => void;
}

export class Decoder {
  private worker: Worker | null = null;
  private readonly waiting = new Map<number, Waiting>();
  private next = 0;

  constructor() {
    if (typeof Worker === "undefined") return;
    this.worker = new Worker(URL.createObjectURL(new Blob([BESIDE], { type: "text/javascript" })));
    this.worker.onmessage = ({ data: [id, image] }) => {
      const one = this.waiting.get(id);
      this.waiting.delete(id);
      if (image) one?.settle(image);
      else one?.refuse(new Error("a picture is no JPEG"));
    };
    // Where none may run the page decodes itself.
    this.worker.onerror = () => {
      this.worker = null;
      for (const { jpeg, settle } of this.waiting.values()) settle(here(jpeg));
      this.waiting.clear();
    };
  }

  decode(jpeg: Uint8Array<ArrayBuffer>): Promise<ImageBitmap> {
    const { worker } = this;
    if (!worker) return here(jpeg);
    return new Promise((settle, refuse) => {
      const id = this.next++;
      this.waiting.set(id, { jpeg, settle, refuse });
      worker.postMessage([id, jpeg]);
    });
  }
}

function here(jpeg: Uint8Array<ArrayBuffer>): Promise<ImageBitmap> {
  return createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
}
